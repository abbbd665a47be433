"""Joined legs: the ellipse around both, from which rays towards a skirt start (PhysXNet section 4.2).

Each leg wraps half of an ellipse around both legs: the angle around the leg, measured from its outer side, is
halved. The inner line of a leg thus lands at the front centre seen from one side of it and at the back centre
seen from the other, where the two legs meet: the skirt is covered once, and continuously.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import REGIONS, Body

LEG_REGIONS = (REGIONS.index("thigh"), REGIONS.index("calf"))
LEG_SLICES = 24
"""Horizontal slices in which the legs are measured."""

STRETCH_SLICES = 12
"""Horizontal slices in which the angle around a leg is stretched to its seam."""

LEAST_HALF_TURN = 0.8
"""Least share of half a turn that half a leg is stretched from: above the crotch it has no inside."""


@dataclass(frozen=True)
class LegSlices:
    """Horizontal slices through both legs at rest, from the lowest up.

    heights: (S,) m. centres: (2, S, 2) middle of the left and the right leg, XY. middle: (S, 2) and radii:
    (S, 2) of the ellipse around both.
    """

    heights: Tensor
    centres: Tensor
    middle: Tensor
    radii: Tensor


def leg_faces(body: Body) -> Tensor:
    """Mask of the faces of thighs and calves: (F,) bool."""
    return (body.regions == LEG_REGIONS[0]) | (body.regions == LEG_REGIONS[1])


def leg_slices(body: Body) -> LegSlices:
    """Slice the legs of a standing body at rest (Z up, legs upright), from the ankles to the crotch.

    Above the crotch a thigh is open on its inside, where the torso begins, and has no middle of its own.
    """
    legs = leg_faces(body)
    corners = body.mesh.vertices[body.mesh.faces[legs].reshape(-1)]
    side = (body.sides[legs] < 0).long().repeat_interleave(3)
    height = corners[:, 2].contiguous()
    edges = torch.linspace(float(height.min()), _crotch(body), LEG_SLICES + 1)
    level = torch.bucketize(height, edges, right=True) - 1
    below = level < LEG_SLICES
    corners, index = corners[below], (side * LEG_SLICES + level)[below, None].expand(-1, 2)
    empty = torch.full((2 * LEG_SLICES, 2), torch.nan)
    lower = empty.scatter_reduce(0, index, corners[:, :2], "amin", include_self=False).view(2, LEG_SLICES, 2)
    upper = empty.scatter_reduce(0, index, corners[:, :2], "amax", include_self=False).view(2, LEG_SLICES, 2)
    filled = ~lower.isnan().any(dim=2).any(dim=0)
    heights = ((edges[1:] + edges[:-1]) / 2)[filled]
    lower, upper = lower[:, filled], upper[:, filled]
    low, high = lower.amin(dim=0), upper.amax(dim=0)
    return LegSlices(heights, (lower + upper) / 2, (low + high) / 2, (high - low) / 2)


def _crotch(body: Body) -> float:
    torso = body.mesh.faces[body.regions == REGIONS.index("torso")]
    return float(body.mesh.vertices[torso.reshape(-1), 2].min())


def joined_rays(slices: LegSlices, points: Tensor, sides: Tensor, along: Tensor) -> tuple[Tensor, Tensor]:
    """Rays from inside the joined legs, one for each point on a leg at rest.

    points: (P, 3) m. sides: (P,) +1 left (at +X), -1 right. along: (P,) any coordinate that runs around each
    leg from one side of its seam to the other (a layout's u). Returns origins and unit directions (P, 3): the
    direction is the ellipse's normal, and the origin lies inside the ellipse by half its smaller radius.
    """
    height = points[:, 2].contiguous()
    centre = torch.where(
        (sides > 0)[:, None],
        _at(slices.heights, slices.centres[0], height),
        _at(slices.heights, slices.centres[1], height),
    )
    middle = _at(slices.heights, slices.middle, height)
    radii = _at(slices.heights, slices.radii, height)
    outward = (points[:, 0] - centre[:, 0]) * sides
    angle = _unrolled(torch.atan2(points[:, 1] - centre[:, 1], outward), height, sides, along) / 2
    around = torch.stack([torch.cos(angle) * sides, torch.sin(angle)], dim=1)
    normal = torch.nn.functional.normalize(around / radii, dim=1)
    inside = middle + radii * around - 0.5 * radii.amin(dim=1, keepdim=True) * normal
    flat = torch.zeros(len(points), 1)
    return torch.cat([inside, points[:, 2:]], dim=1), torch.cat([normal, flat], dim=1)


def _unrolled(angle: Tensor, height: Tensor, sides: Tensor, along: Tensor) -> Tensor:
    """Angles (P,) that reach exactly pi and -pi at the seam, which need not lie just on the inner line.

    Angles run on past the inner line up to the seam; then each half of each leg is stretched, level by level.
    """
    edges = torch.linspace(float(height.min()), float(height.max()), STRETCH_SLICES + 1)
    level = (torch.bucketize(height, edges, right=True) - 1).clamp(0, STRETCH_SLICES - 1)
    middles = (edges[1:] + edges[:-1]) / 2
    unrolled = angle.clone()
    for side in (1, -1):
        leg = sides == side
        late = along > along[leg].median()
        for half in (leg & late, leg & ~late):
            sign = torch.sign(angle[half].sin().sum())
            astray = (angle[half].abs() > 0.5 * torch.pi) & (angle[half].sign() != sign)
            run = angle[half] + torch.where(astray, 2 * torch.pi * sign, 0.0)
            reach = torch.full((STRETCH_SLICES,), torch.pi)
            reach = reach.scatter_reduce(0, level[half], run.abs(), "amax", include_self=False)
            reach = reach.clamp(min=LEAST_HALF_TURN * torch.pi)
            unrolled[half] = run * torch.pi / _at(middles, reach[:, None], height[half])[:, 0]
    return unrolled


def _at(heights: Tensor, values: Tensor, height: Tensor) -> Tensor:
    """Linear interpolation of values (S, C) at other heights (P,) -> (P, C); constant beyond the ends."""
    upper = torch.bucketize(height, heights).clamp(1, len(heights) - 1)
    lower = upper - 1
    share = ((height - heights[lower]) / (heights[upper] - heights[lower])).clamp(0, 1)[:, None]
    return torch.lerp(values[lower], values[upper], share)
