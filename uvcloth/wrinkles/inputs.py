"""Inputs of the wrinkle network: what the runtime knows of a garment's smooth surface, without its place."""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.geometry.units import FREE_FALL
from uvcloth.wrinkles.sheet import Sheet

FARTHEST = 0.04
"""Metres from the skin beyond which its distance no longer counts."""

STRONGEST = 40.0
"""m/s2 of specific force that a network sees at most."""

TENSORS, VECTORS = slice(0, 15), slice(15, 17)
"""Channels of strain, bending, their rates, and bending at rest, as entries 00, 11, 01 on the sheet's axes;
and of the specific force along u and v.
"""

CHANNELS = 23
"""Channels: TENSORS and VECTORS, the force along the normal, the distance to the skin, three of the place at
rest, and the mask.
"""


@dataclass(frozen=True)
class Past:
    """Surface before. points: (2, U, 3) m in the last frames, the older first. forms: (P, 6) in the last."""

    points: Tensor
    forms: Tensor


def first_past(sheet: Sheet, points: Tensor) -> Past:
    """The past of a garment that has long been at points (U, 3) m."""
    return Past(points.expand(2, -1, -1), sheet.forms(points)[0])


def texel_inputs(
    sheet: Sheet, points: Tensor, past: Past, fps: float, away: Tensor
) -> tuple[Tensor, Tensor, Past]:
    """Inputs (P, CHANNELS) at the texels of a frame, axes (P, 3, 3) there, and the past of the next frame.

    points: (U, 3) m of the welded garment. away: (U,) m, its signed distances to the skin.
    """
    forms, tangents = sheet.forms(points)
    axes = sheet.axes(tangents)
    acceleration = (points - 2.0 * past.points[1] + past.points[0]) * fps**2
    force = points.new_tensor(FREE_FALL) - acceleration
    sized = [force.clamp(-STRONGEST, STRONGEST), away[:, None].clamp(-FARTHEST, FARTHEST)]
    values = sheet.places @ torch.cat(sized, dim=1)
    rows = torch.cat(
        [
            forms,
            (forms - past.forms) * fps,
            sheet.rest_bend,
            (axes * values[:, :3, None]).sum(1),
            values[:, 3:],
            sheet.quarters[:, 0],
            torch.ones(len(axes), 1),
        ],
        dim=1,
    )
    return rows, axes, Past(torch.stack([past.points[1], points]), forms)


def input_maps(sheet: Sheet, rows: Tensor) -> Tensor:
    """Maps (..., CHANNELS, H / 2, W / 2) of inputs (..., P, CHANNELS) at the texels, padded across seams."""
    return sheet.padded(rows, TENSORS, VECTORS)
