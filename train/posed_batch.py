"""A mesh in many poses at once, and the planes at its surface beside the points of each pose.

Training visits the same poses again and again, and a network's prediction for one moves little between two
visits. A point that has moved less than its distance at the last search touches nothing; otherwise that
distance bounds the search. Most points need no search, the others a short one. The result is the same.
"""

from dataclasses import dataclass
from typing import Any

import torch
import warp as wp
from torch import Tensor

from uvcloth.geometry.mesh import vertex_normals
from uvcloth.physics.surface import FREE, SEARCH_DISTANCE

from . import kernels
from .launch import array, launch, stream


@dataclass(frozen=True)
class Planes:
    """Planes that keep B x N points off a surface: one each, or none.

    normals: (B, N, 3) the direction in which the signed distance grows, unit length. offsets: (B, N) m,
    product of the plane's points with its normal; FREE where no surface is near.
    """

    normals: Tensor
    offsets: Tensor

    def distance(self, points: Tensor) -> Tensor:
        """Signed distance (B, N) m of points (B, N, 3) from their planes, and huge without one."""
        return (points * self.normals).sum(-1) - self.offsets


@dataclass(frozen=True)
class ClosestPointCache:
    """Points of P poses at their last search, and their distances.

    points: (P, N, 3) m. clearance: (P, N) m, signed distance from the surface then; 0 before the first.
    """

    points: Tensor
    clearance: Tensor


def empty_cache(poses: int, points: int, device: torch.device) -> ClosestPointCache:
    """Make the cache of `poses` poses with `points` points each, before any search."""
    return ClosestPointCache(
        torch.full((poses, points, 3), torch.inf, device=device), torch.zeros(poses, points, device=device)
    )


class PosedMeshBatch:
    """B copies of a closed mesh, each in its own pose: vertices (V, 3) m, faces (F, 3)."""

    def __init__(self, vertices: Tensor, faces: Tensor, count: int) -> None:
        self.device = vertices.device
        wp.load_module(kernels, device=str(self.device))
        self._points = vertices.detach().float().repeat(count, 1, 1).contiguous()
        self._faces = faces.to(self.device)
        with stream(self.device):
            corners = array(faces.to(self.device, torch.int32).reshape(-1).contiguous())
            self._meshes = [wp.Mesh(array(points), corners) for points in self._points]
            ids = [mesh.id for mesh in self._meshes]
            self._ids: Any = wp.array(ids, dtype=wp.uint64, device=str(self.device))

    def update(self, vertices: Tensor) -> None:
        """Move to new poses (B, V, 3), of which there may be fewer than copies."""
        self._points[: len(vertices)].copy_(vertices.detach())
        with stream(self.device):
            for mesh in self._meshes[: len(vertices)]:
                mesh.refit()

    def planes(
        self, points: Tensor, near: float, cache: ClosestPointCache | None = None, corner: bool = False
    ) -> Planes:
        """Planes through the surface points closest to points (B, N, 3) m, of those within `near`, m.

        cache: of these poses; brought up to date, in place. corner: the plane at the nearest vertex of the
        closest face instead, across that vertex's normal (PBNS eq. 5).
        """
        points = points.detach().float().contiguous()
        count, each = points.shape[:2]
        cache = cache or empty_cache(count, each, self.device)
        corners = vertex_normals(self._points, self._faces) if corner else points.new_empty(0, 0, 3)
        normals, offsets = torch.zeros_like(points), torch.full_like(points[..., 0], FREE)
        tensors = (points.view(-1, 3), cache.points.view(-1, 3), cache.clearance.view(-1))
        outputs = map(array, (corners.view(-1, 3), normals.view(-1, 3), offsets.view(-1)))
        query = (self._ids, each, *map(array, tensors), near, SEARCH_DISTANCE)
        launch(kernels.closest_in_batch, count * each, self.device, *query, *outputs)
        return Planes(normals, offsets)
