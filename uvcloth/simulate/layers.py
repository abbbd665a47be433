"""Layers in a simulation: the thickness of the garments beneath a cloth."""

from collections.abc import Sequence

import torch
from torch import Tensor

from uvcloth.physics.layers import Layer
from uvcloth.simulate.cloth import Cloth

LAYER_THICKNESS = 0.006
"""Metres that layers keep apart."""


def inner_thickness(cloth: Cloth, inner: Sequence[Cloth]) -> Tensor:
    """Thickness (n,) m of the garments beneath a cloth's n vertices, at rest."""
    points = cloth.garment.mesh.vertices[cloth.kept]
    room = torch.zeros(len(points))
    for other in inner:
        mesh = other.garment.mesh
        room += LAYER_THICKNESS * Layer(mesh.vertices, mesh.faces).beside(points).covered
    return room
