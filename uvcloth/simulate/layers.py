"""Garments simulated over one another: the room that inner ones take."""

from collections.abc import Sequence

import torch
from torch import Tensor

from uvcloth.physics.layers import Layer
from uvcloth.simulate.cloth import Cloth

THICKNESS = 0.006
"""Metres that layers keep apart."""


def room_below(cloth: Cloth, inner: Sequence[Cloth]) -> Tensor:
    """Metres (n,) that the garments under a cloth's vertices take, at rest."""
    points = cloth.garment.mesh.vertices[cloth.kept]
    room = torch.zeros(len(points))
    for other in inner:
        mesh = other.garment.mesh
        room += THICKNESS * Layer(mesh.vertices, mesh.faces).beside(points).covered
    return room
