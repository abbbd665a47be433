"""Skin that is never seen: body faces that garments cover closely in every frame, or declare hidden."""

from collections.abc import Sequence

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.exposure import middles
from uvcloth.physics.shell import Shell

CLOSE = 0.06
"""Metres in front of the skin within which cloth hides it; under a skirt legs can be seen."""

UNDER = 0.02
"""Metres under the skin within which cloth still hides it: skin that pokes through is best left out."""

MARGIN = 2
"""Rings of faces beside uncovered ones that are kept: between two frames a hem may move."""


class HiddenSkin:
    """Faces of a body that were covered in all frames so far."""

    def __init__(self, body: Body, garments: Sequence[Mesh], hides: Sequence[Tensor] = ()) -> None:
        """Begin with garments at rest; hides: vertices (K,) of the body that garments hide in any pose."""
        self._cloth = Shell.joined(garments)
        self._faces = body.mesh.faces
        self._count = len(body.mesh.vertices)
        self._middles = middles(body.mesh)
        # The rows of the faces that are left.
        self._covered = self._middles.in_tiles(body.mesh.vertices)
        vertices = torch.zeros(len(body.mesh.vertices), dtype=torch.bool)
        for each in hides:
            vertices[each] = True
        self._declared = vertices[body.mesh.faces].all(1)

    def add(self, garments: Sequence[Tensor], body_vertices: Tensor) -> None:
        """Add a frame: garments (N, 3) m and the posed body (V, 3) m."""
        self._cloth.update(torch.cat(list(garments)))
        points, normals = self._middles.subset(self._covered).oriented(body_vertices)
        distance, facing = self._cloth.first_hit(points - UNDER * normals, normals, UNDER + CLOSE)
        self._covered = self._covered[(distance < UNDER + CLOSE) & (facing > 0)]

    def faces(self) -> Tensor:
        """Mask (F,) of the faces that are never seen, without a margin of MARGIN rings."""
        hidden = torch.zeros(len(self._faces), dtype=torch.bool)
        hidden[self._covered] = True
        for _ in range(MARGIN):
            visible = torch.zeros(self._count, dtype=torch.bool)
            visible[self._faces[~hidden]] = True
            hidden = hidden & ~visible[self._faces].any(1)
        return hidden | self._declared
