"""Making of numbered outfits: drawn again until one has no fault."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import Mesh
from uvcloth.wardrobe.check import refuse_faulty
from uvcloth.wardrobe.draw import DrawnOutfit, draw
from uvcloth.wardrobe.sew import sew

TRIES = 12
"""Draws after which an outfit is given up."""


@dataclass(frozen=True)
class MadeOutfit:
    """An outfit without fault: what was drawn, its pieces, innermost first, and why others were refused."""

    drawn: DrawnOutfit
    pieces: tuple[Mesh, ...]
    refused: tuple[str, ...]


def make_outfit(
    number: int, seed: int, types: Sequence[str], vertices: tuple[int, int], body: Body
) -> MadeOutfit:
    """Make the outfit of a number on a body at rest: the same for the same arguments.

    types: of `draw.OUTFITS`. vertices: least and most of all pieces together.
    Raises InputError where TRIES draws one after another are refused, with the last reason.
    """
    refused: list[str] = []
    for attempt in range(TRIES):
        drawn = draw(np.random.default_rng([seed, number, attempt]), types, vertices)
        try:
            pieces = sew(drawn.designs, drawn.meshing, body)
            refuse_faulty([design.kind for design in drawn.designs], pieces, body)
        except InputError as error:
            if body.proxies.get("tights") is None:
                raise
            refused.append(str(error))
            continue
        return MadeOutfit(drawn, pieces, tuple(refused))
    raise InputError(
        f"outfit {number}: {TRIES} draws were refused one after another, the last: {refused[-1]}"
    )
