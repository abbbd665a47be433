"""Moving triangle meshes, and their points that are closest to others."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
import warp as wp
from torch import Tensor

from uvcloth.physics import kernels
from uvcloth.physics.launch import array, launch, stream

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


class MovingMeshes:
    """Closed meshes over the same moving vertices: one tree each, refitted at every update.

    vertices: (V, 3) metres, faces: (F, 3) of each; everything runs on the device of `vertices`. A mesh
    without faces has id 0, which no kernel may query.
    """

    def __init__(self, vertices: Tensor, faces: Sequence[Tensor]) -> None:
        self.device = vertices.device
        wp.load_module(kernels, device=str(self.device))
        self.points = vertices.detach().to(torch.float32).contiguous().clone()
        with stream(self.device):
            self._meshes = [
                wp.Mesh(array(self.points), array(corners.to(self.device, torch.int32).reshape(-1)))
                if len(corners)
                else None
                for corners in faces
            ]
            ids = [mesh.id if mesh else 0 for mesh in self._meshes]
            self.ids: Any = wp.array(ids, dtype=wp.uint64, device=str(self.device))

    def update(self, vertices: Tensor) -> None:
        """Move to new vertex positions (V, 3)."""
        self.points.copy_(vertices.detach())
        with stream(self.device):
            for mesh in filter(None, self._meshes):
                mesh.refit()


class BodySurface(MovingMeshes):
    """One closed mesh: vertices (V, 3) metres, faces (F, 3)."""

    def __init__(self, vertices: Tensor, faces: Tensor) -> None:
        super().__init__(vertices, (faces,))
        self._id = int(self.ids.numpy()[0])

    def closest(self, points: Tensor, max_distance: float = SEARCH_DISTANCE) -> SurfacePoints:
        """The closest surface point of each of N points (N, 3), signed by the side that it is on."""
        points = self._input(points)
        count = len(points)
        distance = points.new_empty(count)
        closest, normal, barycentrics = (torch.zeros_like(points) for _ in range(3))
        face = torch.empty(count, dtype=torch.int32, device=self.device)
        outputs = map(array, (distance, closest, normal, face, barycentrics))
        query = (self._id, array(points), max_distance)
        launch(kernels.closest_point, count, self.device, *query, *outputs)
        return SurfacePoints(distance, closest, normal, face.long(), barycentrics)

    def _input(self, values: Tensor) -> Tensor:
        return values.detach().to(device=self.device, dtype=torch.float32).contiguous()
