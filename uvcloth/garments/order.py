"""Order of garments that are worn over one another."""

from collections.abc import Sequence

from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.physics.layers import wrong_side_percent

MAX_WRONG_SIDE_PERCENT = 1.0
"""Percent of the covered vertices that may be on the wrong side at rest."""


def check_order(garments: Sequence[Garment]) -> None:
    """Raise InputError if two have one name, or one is, at rest, not over those before it that it covers."""
    for index, over in enumerate(garments):
        for under in garments[:index]:
            if over.name == under.name:
                raise InputError(f"garment {over.name}: is named twice, an outfit contains each garment once")
            crossed = wrong_side_percent(
                over.mesh.vertices[None], under.mesh.vertices[None], under.mesh.faces
            )
            if crossed > MAX_WRONG_SIDE_PERCENT:
                raise InputError(
                    f"garment {over.name}: cannot be worn over the garment {under.name}, at rest it is "
                    f"below it in {crossed:.0f} % of the places where they meet"
                )
