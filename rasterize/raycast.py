"""Rays and closest points between two meshes: the papers' transference matrices T^BC, T^CB and T^XB."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from rasterize.gather import gather

EMBREE_SIZE = 100.0
"""Diagonal of the box of a mesh in Embree's units."""


@dataclass(frozen=True)
class Hits:
    """Hits of R rays, or closest points of R points, on a mesh.

    face: (R,) int64, -1 for a miss. barycentrics: (R, 3), zero there. distance: (R,) metres, along
    the ray's direction (negative behind its origin); infinite there. For closest points it is positive.
    """

    face: Tensor
    barycentrics: Tensor
    distance: Tensor

    @property
    def hit(self) -> Tensor:
        """Mask of the rays that met the mesh: (R,) bool."""
        return self.face >= 0

    def interpolate(self, vertices: Tensor, faces: Tensor) -> Tensor:
        """Hit points on the moved mesh (..., V, 3) with faces (F, 3): (..., R, 3), zero if none."""
        return gather(vertices, faces[self.face.clamp(min=0)], self.barycentrics)


def cast_rays(
    origins: Tensor,
    directions: Tensor,
    vertices: Tensor,
    faces: Tensor,
    *,
    max_distance: float,
    both_ways: bool,
) -> Hits:
    """Find the nearest face along each ray, or along both it and its opposite.

    origins, directions: (R, 3), directions of any length above zero. vertices: (V, 3). faces: (F, 3).
    max_distance: metres; hits farther away count as missed.
    """
    towards = torch.nn.functional.normalize(directions.double(), dim=1)
    if both_ways:
        origins, towards = torch.cat([origins, origins]), torch.cat([towards, -towards])
    hits = _first_hits(origins, towards, vertices, faces)
    if both_ways:
        ahead, behind = hits.distance.chunk(2)
        backwards = behind < ahead
        ray = torch.arange(len(ahead)) + torch.where(backwards, len(ahead), 0)
        hits = Hits(hits.face[ray], hits.barycentrics[ray], torch.where(backwards, -behind, ahead))
    far = hits.distance.abs() > max_distance
    return Hits(
        torch.where(far, -1, hits.face),
        torch.where(far[:, None], 0.0, hits.barycentrics),
        torch.where(far, torch.inf, hits.distance),
    )


def _first_hits(origins: Tensor, directions: Tensor, vertices: Tensor, faces: Tensor) -> Hits:
    """Nearest hit along each unit direction (R, 3), the barycentrics computed in float64."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    points = vertices.double().numpy()
    # Embree has float32: the mesh is moved to a corner of its box, and enlarged, for its rounding.
    corner, used = points.min(0), points[np.unique(faces.numpy())]
    scale = EMBREE_SIZE / float(np.linalg.norm(np.ptp(used, 0)) or 1.0)
    scene = EmbreeScene()
    TriangleMesh(scene, ((points - corner) * scale).astype(np.float32), faces.int().numpy())
    starts = ((origins.float().double().numpy() - corner) * scale).astype(np.float32)
    first = scene.run(starts, directions.float().numpy())
    face = torch.from_numpy(np.asarray(first, dtype=np.int64))
    a, b, c = vertices.double()[faces[face.clamp(min=0)]].unbind(1)
    normal = torch.linalg.cross(b - a, c - a)
    distance = ((a - origins.double()) * normal).sum(1) / (directions * normal).sum(1)
    barycentrics = _barycentrics(origins.double() + distance[:, None] * directions, a, b, c)
    missed = (face < 0) | ~torch.isfinite(distance)
    return Hits(
        torch.where(missed, -1, face),
        torch.where(missed[:, None], 0.0, barycentrics).float(),
        torch.where(missed, torch.inf, distance).float(),
    )


def _barycentrics(points: Tensor, a: Tensor, b: Tensor, c: Tensor) -> Tensor:
    """Barycentrics (R, 3) of points in the planes of their triangles, clamped to the triangles."""
    normal = torch.linalg.cross(b - a, c - a)
    square = (normal * normal).sum(1).clamp(min=1e-30)
    first = (torch.linalg.cross(c - b, points - b) * normal).sum(1) / square
    second = (torch.linalg.cross(a - c, points - c) * normal).sum(1) / square
    weights = torch.stack([first, second, 1 - first - second], dim=1).clamp(min=0.0)
    return weights / weights.sum(1, keepdim=True)


def closest_points(points: Tensor, vertices: Tensor, faces: Tensor) -> Hits:
    """The surface point nearest to each point: points (R, 3), vertices (V, 3), faces (F, 3); never misses."""
    from rasterize.closest import closest_on_mesh

    face, barycentrics, distance = closest_on_mesh(points, vertices, faces)
    return Hits(face.long(), barycentrics, distance)


def body_to_garment(
    points: Tensor, normals: Tensor, garment: Tensor, garment_faces: Tensor, max_distance: float
) -> Hits:
    """T^BC (PhysXNet eq. 8): the garment point along the normal of each body texel, in rest pose.

    points, normals: (M, 3) of the texels. garment: (N, 3), its faces counter-clockwise seen from outside. A
    ray that misses, or that meets the cloth from outside (it then covers another limb), sees no garment.
    """
    hits = cast_rays(points, normals, garment, garment_faces, max_distance=max_distance, both_ways=False)
    a, b, c = garment[garment_faces[hits.face.clamp(min=0)]].unbind(1)
    unseen = ~hits.hit | ((torch.linalg.cross(b - a, c - a) * normals).sum(1) <= 0)
    return Hits(
        torch.where(unseen, -1, hits.face),
        torch.where(unseen[:, None], 0.0, hits.barycentrics),
        torch.where(unseen, torch.inf, hits.distance),
    )


def garment_to_body(
    garment: Tensor, normals: Tensor, body: Tensor, body_faces: Tensor, max_distance: float
) -> Hits:
    """T^CB and T^XB (PhysXNet eq. 3 and 9): the body point along each garment vertex's normal, in rest pose.

    garment, normals: (N, 3). body: (V, 3). Rays go both ways, for inside-out garments too.
    """
    return cast_rays(garment, normals, body, body_faces, max_distance=max_distance, both_ways=True)
