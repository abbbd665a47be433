"""Pressing: points of inner garments that come through an outer one are moved beneath its faces.

Outer garments are kept off inner ones vertex by vertex; between the vertices faces may still cut through.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.geometry.mesh import Mesh, WeldedMesh, vertex_normals, welded
from uvcloth.physics.exposure import COVER_DISTANCE
from uvcloth.physics.shell import Shell

BENEATH = 0.001
"""Metres beneath the faces of an outer garment at which points that come through it are left."""

DEEPEST = 0.015
"""Metres outside an outer garment beyond which a point is left there: it would tear the inner one."""


@dataclass(frozen=True)
class Pressing:
    """Garments, the innermost first, kept beneath those over them where these cover them at rest.

    meshes, shells: the garments. covered: by inner and outer garment, the inner one's points (n,) that it
    covers: the ray outwards first meets its inner side.
    """

    meshes: tuple[WeldedMesh, ...]
    shells: tuple[Shell, ...]
    covered: dict[tuple[int, int], Tensor]

    @classmethod
    def of(cls, garments: Sequence[Mesh]) -> "Pressing":
        """Prepare garments at rest."""
        meshes = tuple(welded(mesh.vertices, mesh.faces) for mesh in garments)
        shells = tuple(Shell(mesh.points, mesh.faces) for mesh in meshes)
        covered = {}
        for inner, mesh in enumerate(meshes):
            normals = vertex_normals(mesh.points, mesh.faces)
            for outer in range(inner + 1, len(meshes)):
                distance, facing = shells[outer].first_hit(mesh.points, normals, COVER_DISTANCE)
                covered[inner, outer] = torch.nonzero((distance < COVER_DISTANCE) & (facing > 0)).squeeze(1)
        return cls(meshes, shells, covered)

    def pressed(self, garments: Sequence[Tensor]) -> tuple[Tensor, ...]:
        """Garments (N, 3) m with the points moved inwards that come through a garment over theirs."""
        finished = list(garments)
        for inner in reversed(range(len(garments))):
            mesh = self.meshes[inner]
            points = garments[inner][mesh.kept]
            normals = vertex_normals(points, mesh.faces)
            for outer in range(inner + 1, len(garments)):
                rows = self.covered[inner, outer]
                distance, facing = self.shells[outer].first_hit(points[rows], -normals[rows], DEEPEST)
                through = (distance < DEEPEST) & (facing < 0)
                points[rows] -= torch.where(through, distance + BENEATH, 0.0)[:, None] * normals[rows]
            self.shells[inner].update(points)
            finished[inner] = points[mesh.places]
        return tuple(finished)
