"""Closest points of surfaces, as tensors; the runtime searches them."""

from dataclasses import dataclass

import torch
from torch import Tensor

from rasterize.raycast import Hits
from uvcloth.player.meshes import MovingMeshes

FREE = -1.0e6
"""Plane offset of a point without a plane, metres: no product with a normal is less."""

SEARCH_DISTANCE = 0.2
"""Metres within which the closest surface point is sought; deeper than any body part is thick."""


@dataclass(frozen=True)
class SurfacePoints:
    """Closest points on a body's surface for N points.

    signed_distance: (N,) metres, negative inside; the reach where nothing is closer.
    points, normals: (N, 3) the closest point and the direction in which the signed distance grows.
    faces: (N,) int64, -1 where nothing is within reach. barycentrics: (N, 3).
    """

    signed_distance: Tensor
    points: Tensor
    normals: Tensor
    faces: Tensor
    barycentrics: Tensor


class BodySurface:
    """One closed mesh: vertices (V, 3) metres, faces (F, 3).

    It is searched on the processor; results are on the device of their points.
    """

    def __init__(self, vertices: Tensor, faces: Tensor) -> None:
        self.points = vertices.detach().float().clone()
        self._moving = MovingMeshes(self.points.cpu().numpy(), [faces.cpu().numpy()])

    def update(self, vertices: Tensor) -> None:
        """Move to new vertex positions (V, 3)."""
        self.points.copy_(vertices.detach())
        self._moving.move(self.points.cpu().numpy())

    def closest(self, points: Tensor, max_distance: float = SEARCH_DISTANCE) -> SurfacePoints:
        """The closest surface point of each of N points (N, 3), signed by the side that it is on."""
        closest = self._moving.signed_distances(0, points.detach().cpu().numpy(), max_distance)
        results = closest.distances, closest.places, closest.normals, closest.faces, closest.weights
        distance, places, normals, faces, weights = (
            torch.from_numpy(result).to(points.device) for result in results
        )
        return SurfacePoints(distance, places, normals, faces.long(), weights)


def closest_points(points: Tensor, vertices: Tensor, faces: Tensor) -> Hits:
    """The surface point nearest to each point: points (R, 3), vertices (V, 3), faces (F, 3).

    All are on the processor. It misses only points that are not finite.
    """
    meshes = MovingMeshes(vertices.detach().numpy(), [faces.numpy()])
    face, barycentrics = map(torch.from_numpy, meshes.closest_faces(0, points.detach().numpy(), torch.inf))
    hits = Hits(face.long(), barycentrics, torch.full((len(points),), torch.inf))
    away = (points.float() - hits.interpolate(vertices.float(), faces)).norm(dim=1)
    return Hits(hits.face, hits.barycentrics, torch.where(hits.hit, away, torch.inf))
