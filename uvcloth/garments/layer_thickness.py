"""Thickness of the garments that lie beneath others."""

from collections.abc import Iterable

import torch
from torch import Tensor

from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.layers import Layer

LAYER_THICKNESS = 0.006
"""Metres that layers keep apart."""


def inner_thickness(points: Tensor, inner: Iterable[Mesh]) -> Tensor:
    """Thickness (n,) m of inner garments beneath points (n, 3) m of an outer one, all at rest."""
    thickness = torch.zeros(len(points))
    for mesh in inner:
        thickness += LAYER_THICKNESS * Layer(mesh.vertices, mesh.faces).beside(points).covered
    return thickness
