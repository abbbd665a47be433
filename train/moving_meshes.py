"""Meshes that move by steps of training, on its device: searched by Warp, on a GPU too."""

from collections.abc import Sequence
from typing import Any

import torch
import warp as wp
from torch import Tensor

from uvcloth.geometry.mesh import vertex_normals
from uvcloth.physics.layers import COVERING_COSINE, LayerDistance

from . import kernels
from .launch import array, launch, stream


class MeshTrees:
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


class MovingSheet(MeshTrees):
    """One open mesh: vertices (M, 3) metres, faces (F, 3)."""

    def __init__(self, vertices: Tensor, faces: Tensor) -> None:
        super().__init__(vertices, (faces,))
        self._faces = faces
        self._normals = vertex_normals(self.points, faces)
        self._id = int(self.ids.numpy()[0])

    def update(self, vertices: Tensor) -> None:
        """Move to new vertex positions (M, 3)."""
        super().update(vertices)
        self._normals.copy_(vertex_normals(self.points, self._faces))

    def beside(self, points: Tensor, reach: float) -> LayerDistance:
        """Closest places of the sheet for points (N, 3) m, no farther than reach, m."""
        points = points.detach().float().contiguous()
        distance, normals = torch.zeros_like(points[:, 0]), torch.zeros_like(points)
        faces = torch.empty_like(distance, dtype=torch.int32)
        query = (self._id, array(self._normals), array(points), reach, COVERING_COSINE)
        outputs = map(array, (faces, distance, normals))
        launch(kernels.beside_sheet, len(points), self.device, *query, *outputs)
        return LayerDistance(faces.long(), distance, normals)
