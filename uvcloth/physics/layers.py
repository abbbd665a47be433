"""Layers of garments: the side of an inner one that the vertices of an outer one are on."""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.geometry.mesh import vertex_normals
from uvcloth.player.meshes import MovingMeshes

LAYER_SEARCH_DISTANCE = 0.03
"""Metres within which an inner garment is looked for."""

COVERING_COSINE = 0.7
"""Least cosine between its normal and the way to a point that it covers: beside its hem it does not."""


@dataclass(frozen=True)
class LayerDistance:
    """Closest points of an inner garment for N points.

    faces: (N,) int64, the closest face, -1 where none covers the point. distance: (N,) m along its normals,
    negative on its inner side, and normals: (N, 3); both count only where it covers the point.
    """

    faces: Tensor
    distance: Tensor
    normals: Tensor

    @property
    def covered(self) -> Tensor:
        """Mask of the points that the garment is near, and not beside its hem: (N,) bool."""
        return self.faces >= 0


class Layer:
    """A moving garment beneath others: vertices (M, 3) metres, faces (F, 3).

    It is searched on the processor; results are on the device of their points.
    """

    def __init__(self, vertices: Tensor, faces: Tensor) -> None:
        self.points, self.faces = vertices.detach().float().clone(), faces
        self._normals = vertex_normals(self.points, faces)
        self._moving = MovingMeshes(self.points.cpu().numpy(), [faces.cpu().numpy()])

    def update(self, vertices: Tensor) -> None:
        """Move to new vertex positions (M, 3)."""
        self.points.copy_(vertices.detach())
        self._normals.copy_(vertex_normals(self.points, self.faces))
        self._moving.move(self.points.cpu().numpy())

    def beside(self, points: Tensor, reach: float = LAYER_SEARCH_DISTANCE) -> LayerDistance:
        """Closest places of the garment for points (N, 3) m, no farther than reach, m."""
        points = points.detach().float()
        faces, weights = (
            torch.from_numpy(each).to(points.device)
            for each in self._moving.closest_faces(0, points.cpu().numpy(), reach)
        )
        corners, shares = self.faces[faces.long()], weights[..., None]
        direction = torch.nn.functional.normalize((shares * self._normals[corners]).sum(1), dim=1)
        away = points - (shares * self.points[corners]).sum(1)
        along = (away * direction).sum(1)
        covered = (faces >= 0) & (along.abs() >= COVERING_COSINE * away.norm(dim=1))
        return LayerDistance(faces.long().where(covered, -1), along, direction)


@dataclass(frozen=True)
class InnerLayer:
    """Contact of an outer garment with one beneath it.

    touches: (N,) int32, a bit per part of the body that may touch a vertex of the outer garment; parts: (F,)
    int32, the same of the layer's faces. A sleeve touches sleeves, not the trousers that an arm is pressed
    into.
    """

    layer: Layer
    touches: Tensor
    parts: Tensor

    def find(self, vertices: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Vertices of the outer garment (N, 3) m that the layer covers, as it lies now.

        Returns their rows (n,), their distance (n,) m and its normals there (n, 3).
        """
        closest = self.layer.beside(vertices)
        rows = torch.nonzero(closest.covered & (self.parts[closest.faces] & self.touches != 0)).squeeze(1)
        return rows, closest.distance[rows], closest.normals[rows]


def inner_layer(layer: Layer, touches: Tensor, layer_touches: Tensor) -> InnerLayer:
    """Contact of the vertices of an outer garment with a layer.

    touches: (N,) int32, a bit per part of the body that may touch a vertex; layer_touches: (M,), the same of
    the layer's.
    """
    first, second, third = layer_touches[layer.faces].unbind(1)
    return InnerLayer(layer, touches, first | second | third)


def wrong_side_percent(outer: Tensor, inner: Tensor, faces: Tensor) -> float:
    """Percent of an outer garment's vertices that are on the inner side of an inner one, of those it covers.

    outer: (F, N, 3), inner: (F, M, 3) m, over all frames; 0 if it covers none.
    """
    wrong, covered = wrong_side_counts(outer, inner, faces).sum(0).tolist()
    return float(100.0 * wrong / max(covered, 1))


def wrong_side_counts(outer: Tensor, inner: Tensor, faces: Tensor) -> Tensor:
    """Numbers of an outer garment's vertices in each frame, (F, 2) int64: those on the inner side of an inner
    one, and all that it covers. outer: (F, N, 3), inner: (F, M, 3) m.
    """
    layer = Layer(inner[0], faces)
    counts = torch.empty(len(outer), 2, dtype=torch.int64)
    for count, points, vertices in zip(counts, outer, inner, strict=True):
        layer.update(vertices)
        closest = layer.beside(points)
        count[0] = (closest.covered & (closest.distance < 0)).sum()
        count[1] = closest.covered.sum()
    return counts
