"""Garments simulated over one another: the order that they need, and the room that inner ones take."""

from collections.abc import Sequence

import torch
from torch import Tensor

from rasterize.errors import InputError
from uvcloth.physics.layers import Layer, wrong_side_percent
from uvcloth.simulate.cloth import Cloth

THICKNESS = 0.006
"""Metres that layers keep apart."""

MOST_CROSSED = 1.0
"""Percent of the covered vertices that may be on the wrong side at rest."""


def check_order(cloths: Sequence[Cloth]) -> None:
    """Raise InputError if, at rest, one garment is not over those before it wherever they cover it."""
    for index, outer in enumerate(cloths):
        for inner in cloths[:index]:
            over, under = outer.garment, inner.garment
            crossed = wrong_side_percent(
                over.mesh.vertices[None], under.mesh.vertices[None], under.mesh.faces
            )
            if crossed > MOST_CROSSED:
                raise InputError(
                    f"garment {over.name}: cannot be worn over the garment {under.name}, at rest it is "
                    f"under it in {crossed:.0f} % of the places where they meet"
                )


def room_below(cloth: Cloth, inner: Sequence[Cloth]) -> Tensor:
    """Metres (n,) that the garments under a cloth's vertices take, at rest."""
    points = cloth.garment.mesh.vertices[cloth.kept]
    room = torch.zeros(len(points))
    for other in inner:
        mesh = other.garment.mesh
        room += THICKNESS * Layer(mesh.vertices, mesh.faces).beside(points).covered
    return room
