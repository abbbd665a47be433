"""Thickness of the garments that lie beneath others."""

from collections.abc import Iterable, Sequence

import torch
from torch import Tensor

from uvcloth.physics.layers import Layer

LAYER_THICKNESS = 0.006
"""Metres that layers keep apart."""


def inner_thickness(points: Tensor, inner: Iterable[tuple[Tensor, Tensor]]) -> Tensor:
    """Thickness (n,) m of inner garments beneath points (n, 3) m of an outer one, all at rest.

    inner: vertices (N, 3) m and faces (M, 3) of each.
    """
    thickness = torch.zeros(len(points))
    for vertices, faces in inner:
        thickness += LAYER_THICKNESS * Layer(vertices, faces).beside(points).covered
    return thickness


def outfit_thickness(points: Sequence[Tensor], meshes: Sequence[tuple[Tensor, Tensor]]) -> Tensor:
    """Thickness (n,) m of the garments beneath all points of an outfit at rest, the innermost garment first.

    points: (n_i, 3) m of each garment. meshes: vertices (N, 3) m and faces (M, 3) of each.
    """
    return torch.cat([inner_thickness(each, meshes[:index]) for index, each in enumerate(points)])
