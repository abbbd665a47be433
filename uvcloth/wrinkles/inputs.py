"""Inputs of the wrinkle network: what the runtime knows of a garment's smooth surface, without its place."""

from dataclasses import dataclass

import torch
from torch import Tensor

from rasterize.bake import scatter_map
from uvcloth.geometry.units import FREE_FALL
from uvcloth.physics.surface import BodySurface
from uvcloth.wrinkles.sheet import Forms, Sheet

FARTHEST = 0.04
"""Metres from the skin beyond which its distance no longer counts."""

STRONGEST = 40.0
"""m/s2 of specific force that a network sees at most."""

TENSORS = tuple(slice(first, first + 3) for first in (0, 3, 6, 9, 12))
"""Channels of strain, bending, their rates, and bending at rest, that turn with the sheet as tensors do."""

VECTORS = (slice(15, 17),)
"""Channels of the specific force along u and v."""

CHANNELS = 23
"""Channels: TENSORS and VECTORS, the force along the normal, the distance to the skin, three of the place at
rest, and the mask.
"""


@dataclass(frozen=True)
class Past:
    """Surface in the frames before. points: (2, U, 3) m, the older first. forms: in the last frame."""

    points: Tensor
    forms: Forms


def first_past(sheet: Sheet, points: Tensor) -> Past:
    """The past of a garment that has long been at points (U, 3) m."""
    return Past(points.expand(2, -1, -1), sheet.forms(points)[0])


def texel_inputs(
    sheet: Sheet, points: Tensor, past: Past, fps: float, skin: BodySurface
) -> tuple[Tensor, Tensor, Past]:
    """Inputs (P, CHANNELS) at the texels of a frame, axes (P, 3, 3) there, and the past of the next frame.

    points: (U, 3) m of the welded garment. skin: of the body in this frame.
    """
    forms, tangents = sheet.forms(points)
    axes = sheet.axes(tangents)
    acceleration = (points - 2.0 * past.points[1] + past.points[0]) * fps**2
    force = points.new_tensor(FREE_FALL) - acceleration
    away = skin.closest(points, FARTHEST).signed_distance.clamp(-FARTHEST, FARTHEST)
    values = sheet.at_texels(torch.cat([force.clamp(-STRONGEST, STRONGEST), away[:, None]], dim=1))
    local = (axes * values[:, :3, None]).sum(1)
    rows = torch.cat(
        [
            forms.strain,
            forms.bend,
            (forms.strain - past.forms.strain) * fps,
            (forms.bend - past.forms.bend) * fps,
            sheet.rest_bend,
            local,
            values[:, 3:],
            sheet.at_texels(sheet.mesh.points),
            torch.ones(len(axes), 1),
        ],
        dim=1,
    )
    return rows, axes, Past(torch.stack([past.points[1], points]), forms)


def input_maps(sheet: Sheet, rows: Tensor) -> Tensor:
    """Maps (..., CHANNELS, H, W) of inputs (..., P, CHANNELS) at the texels, padded across seams."""
    return sheet.padded(scatter_map(rows, sheet.texels), TENSORS, VECTORS)
