"""Moving meshes that rays meet, as tensors; the runtime follows the rays."""

from collections.abc import Sequence
from typing import Self

import torch
from torch import Tensor

from uvcloth.geometry.mesh import JoinedMesh, Mesh, join_meshes
from uvcloth.player.shell import MovingShell


class Shell:
    """Mesh for ray casting, closed or not: vertices (V, 3) metres, faces (F, 3).

    Rays are followed on the processor; results are on the device of their points.
    """

    def __init__(self, vertices: Tensor, faces: Tensor) -> None:
        self._moving = MovingShell(vertices.detach().cpu().numpy(), faces.cpu().numpy())

    @classmethod
    def joined(cls, meshes: Sequence[Mesh | JoinedMesh]) -> Self:
        """Several meshes as one, in their order."""
        whole = join_meshes((mesh.vertices, mesh.faces) for mesh in meshes)
        return cls(whole.vertices, whole.faces)

    def update(self, vertices: Tensor) -> None:
        """Move to new vertex positions (V, 3)."""
        self._moving.move(vertices.detach().cpu().numpy())

    def first_hit(self, points: Tensor, directions: Tensor, reach: float) -> tuple[Tensor, Tensor]:
        """First hits of rays from points along unit directions, (P, 3) each.

        Returns distances (P,) m, beyond the reach where nothing is within, and the cosines (P,) between ray
        and normal there: negative from outside.
        """
        distance, facing, _, _ = self.first_faces(points, directions, reach)
        return distance, facing

    def first_faces(
        self, points: Tensor, directions: Tensor, reach: float
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """First hits as of `first_hit`, with the faces (P,) int64 that are met, -1 for none, and barycentrics
        (P, 3).
        """
        starts, ways = (each.detach().cpu().numpy() for each in (points, directions))
        hits = self._moving.first_hits(starts, ways, reach)
        results = hits.distances, hits.cosines, hits.faces, hits.weights
        distance, facing, faces, barycentrics = (
            torch.from_numpy(result).to(points.device) for result in results
        )
        return distance, facing, faces.long(), barycentrics
