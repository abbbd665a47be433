"""Arms inside the torso: a pose that keypoints allow, since they do not tell in front from behind."""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import REGIONS, Body
from uvcloth.geometry.once import once_per_record
from uvcloth.tryon.landmarks import posed_landmarks

LEVELS = 6
"""Heights of the torso, from the hips to the shoulders, at each of which three balls fill it."""

ARM_RADIUS, TOLERATED = 0.03, 0.02
"""Metres: radius of a forearm, and depth in the torso that costs as much as one standard deviation."""


@dataclass(frozen=True)
class Overlap:
    """Balls in the torso and points in forearms and hands, each attached to a joint.

    joints: (S,) and (P,). centres: (S, 3) and points: (P, 3) m at rest. radii: (S,) m.
    """

    ball_joints: Tensor
    centres: Tensor
    radii: Tensor
    arm_joints: Tensor
    points: Tensor

    def costs(self, transforms: Tensor) -> Tensor:
        """Costs (B,) of arms inside the torso of a body posed by joint transforms (B, J, 3, 4)."""
        balls = posed_landmarks(self.ball_joints, self.centres, transforms)
        arms = posed_landmarks(self.arm_joints, self.points, transforms)
        depth = (self.radii + ARM_RADIUS - (arms[:, :, None] - balls[:, None]).norm(dim=-1)).amax(-1)
        return (depth.clamp(min=0.0) / TOLERATED).square().sum(-1) / 2


@once_per_record
def overlap_of(body: Body) -> Overlap:
    """Balls and points of a body."""
    roles, heads = body.skeleton.roles, body.skeleton.heads
    spine = [roles[role] for role in ("hips", "lower_spine", "middle_spine", "upper_spine") if role in roles]
    skin = body.mesh.vertices[body.mesh.faces[body.regions == REGIONS.index("torso")].unique()]
    low, high = heads[roles["hips"], 2], heads[roles["left_upper_arm"], 2]
    balls: list[tuple[int, Tensor, Tensor]] = []
    for number in range(LEVELS):
        height = low + (high - low) * number / LEVELS
        ring = skin[(skin[:, 2] - height).abs() < (high - low) / LEVELS]
        if not len(ring):
            continue
        half = (ring.amax(0) - ring.amin(0)) / 2
        middle = (ring.amax(0) + ring.amin(0)) / 2
        joint = max((each for each in spine if heads[each, 2] <= height), key=lambda each: heads[each, 2])
        aside = (half[0] - half[1]).clamp(min=0.0)
        balls += [(joint, torch.stack([x * aside, middle[1], height]), half[1]) for x in (-1.0, 0.0, 1.0)]
    arms = [
        (
            roles[f"{side}_{part}"],
            torch.lerp(heads[roles[f"{side}_{part}"]], heads[roles[f"{side}_{end}"]], share),
        )
        for side in ("left", "right")
        for part, end, shares in (("forearm", "hand", (0.2, 0.5, 0.8)), ("hand", "fingers", (0.0, 0.7)))
        for share in shares
        if f"{side}_{end}" in roles
    ]
    joints, centres, radii = zip(*balls, strict=True)
    arm_joints, points = zip(*arms, strict=True)
    return Overlap(
        torch.tensor(joints),
        torch.stack(centres),
        torch.stack(radii),
        torch.tensor(arm_joints),
        torch.stack(points),
    )
