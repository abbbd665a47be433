"""Pinned vertices of an outfit: its holding bands, a part of them, or those that a file names."""

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.band import holding_band
from uvcloth.garments.garment import Garment
from uvcloth.garments.numbered import numbered

PIN_SETS = ("band", "waist", "neck", "none")
"""Named vertex sets: the holding band, or its part below or above the middle of the trunk."""


def pinned(garments: Sequence[Garment], body: Body, names: Sequence[str]) -> Tensor:
    """The union of the named vertex sets of an outfit: (N,) bool over its garments, one after another.

    names: words of PIN_SETS, or text files of vertex numbers, counted from 0 through all garments' meshes.
    Raises InputError for a name that is neither, a set without a vertex, and a number that no vertex has.
    """
    count = sum(len(garment.mesh.vertices) for garment in garments)
    outfit = " and ".join(garment.name for garment in garments)
    held = torch.zeros(count, dtype=torch.bool)
    for name in names:
        if name == "none":
            continue
        if name in PIN_SETS:
            pins = torch.cat([_place(garment, body, name) for garment in garments])
        else:
            path = Path(name)
            if not path.is_file():
                places = ", ".join(PIN_SETS)
                raise InputError(
                    f"--pins {path}: neither a readable file of vertex numbers nor one of {places}"
                )
            pins = numbered(path, count, outfit)
        if not pins.any():
            raise InputError(f"--pins {name}: names no vertex of {outfit}")
        held |= pins
    return held


def _place(garment: Garment, body: Body, place: str) -> Tensor:
    band = holding_band(garment, body).vertices
    middle = 0.5 * float(body.head_of("hips")[2] + body.head_of("left_upper_arm")[2])
    low = garment.mesh.vertices[:, 2] < middle
    return {"band": band, "waist": band & low, "neck": band & ~low}[place]
