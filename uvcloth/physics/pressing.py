"""Pressing: points of inner garments that come through an outer one are moved beneath its faces.

Outer garments are kept off inner ones vertex by vertex; between the vertices faces may still cut through.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.geometry.mesh import Mesh, WeldedMesh, welded
from uvcloth.physics.layers import Layer

BENEATH = 0.001
"""Metres beneath the faces of an outer garment at which points that come through it are left."""

DEEPEST = 0.015
"""Metres outside an outer garment beyond which a point is left there: it would tear the inner one."""

COVER_DISTANCE = 0.3
"""Metres within which an outer garment covers an inner one at rest: a skirt drapes away from trousers."""


@dataclass(frozen=True)
class Pressing:
    """Garments, the innermost first, kept beneath those over them where these cover them at rest.

    meshes, layers: the garments. covered: by inner and outer garment, the inner one's points (n,) that it
    covers.
    """

    meshes: tuple[WeldedMesh, ...]
    layers: tuple[Layer, ...]
    covered: dict[tuple[int, int], Tensor]

    @classmethod
    def of(cls, garments: Sequence[Mesh]) -> "Pressing":
        """Prepare garments at rest."""
        meshes = tuple(welded(mesh.vertices, mesh.faces) for mesh in garments)
        layers = tuple(Layer(mesh.points, mesh.faces) for mesh in meshes)
        covered = {}
        for inner in range(len(meshes)):
            for outer in range(inner + 1, len(meshes)):
                closest = layers[outer].beside(layers[inner].points, COVER_DISTANCE)
                covered[inner, outer] = torch.nonzero(closest.covered & (closest.distance < 0)).squeeze(1)
        return cls(meshes, layers, covered)

    def pressed(self, garments: Sequence[Tensor]) -> tuple[Tensor, ...]:
        """Garments (N, 3) m with the points moved that come through a garment over theirs."""
        finished = list(garments)
        for inner in reversed(range(len(garments))):
            points = garments[inner][self.meshes[inner].kept]
            for outer in range(inner + 1, len(garments)):
                rows = self.covered[inner, outer]
                closest = self.layers[outer].beside(points[rows])
                met = closest.covered & (closest.distance < DEEPEST)
                lack = torch.where(met, closest.distance + BENEATH, 0.0).clamp(min=0.0)
                points[rows] -= lack[:, None] * closest.normals
            self.layers[inner].update(points)
            finished[inner] = points[self.meshes[inner].places]
        return tuple(finished)
