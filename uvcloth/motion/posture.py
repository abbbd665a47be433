"""Check of a motion on the body: the person stands, knees bend forwards, left is on the left."""

from collections.abc import Mapping

import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.geometry.rotations import rotate_back
from uvcloth.motion.anatomy import unit
from uvcloth.motion.clip import Clip

MOST = 0.5
"""Share of the frames that has to be exceeded for a motion to pass a check."""

HEAD_HEIGHT = 0.6
"""Height of the head over the feet, in lengths of a thigh, below which a person lies."""

FARTHEST = 1e5
"""Metres from the origin beyond which a person is not followed: single precision leaves 8 mm there."""

BENT = 0.25
"""Sine of the bend from which a knee is bent."""

ADVICE = "name a frame in which the person stands with --rest-frame, or the joints with --joints"


def check_posture(clip: Clip, lying: bool = False) -> None:
    """Raise InputError if a clip on a body's skeleton cannot be how a person moved.

    No frame may be farther than FARTHEST from the origin.
    In more than MOST of the frames, the feet have to be below the hips and these below the head (not checked
    where `lying`), bent knees have to bend forwards, and left arm and left leg have to be on one side.
    """
    positions = require_near(clip)
    roles = clip.skeleton.roles
    upright = _upright(positions, roles)
    if upright <= MOST and not lying:
        raise InputError(
            f"feet are below hips and hips below the head in only {upright:.0%} of the frames: give the up "
            f"axis with --up y or --up z, also if the person really lies down; or {ADVICE}"
        )
    one_side = _one_side(positions, roles)
    if one_side <= MOST:
        raise InputError(
            f"left arm and left leg are on one side in only {one_side:.0%} of the frames: left and right "
            f"joints are exchanged, or the rest pose is wrong: {ADVICE}"
        )
    forwards = _bending_forwards(clip, positions, roles)
    if forwards <= MOST:
        raise InputError(
            f"knees bend backwards in {1 - forwards:.0%} of the frames in which they bend: left and right "
            f"joints are exchanged, or the rest pose is wrong: {ADVICE}"
        )


def require_near(clip: Clip) -> Tensor:
    """Joints (T, J, 3) of a clip, m. Raises InputError naming a frame beyond FARTHEST from the origin."""
    positions = clip.positions()
    away = ~(positions.norm(dim=-1).amax(1) <= FARTHEST)
    if bool(away.any()):
        frame = int(away.int().argmax())
        raise InputError(f"frame {frame}: the person is more than {FARTHEST / 1000:.0f} km from the origin")
    return positions


def _upright(positions: Tensor, roles: Mapping[str, int]) -> float:
    hips = positions[:, [roles["left_thigh"], roles["right_thigh"]]].mean(1)
    feet = positions[:, [roles["left_foot"], roles["right_foot"]]].mean(1)
    head = positions[:, roles.get("head", roles["left_upper_arm"])]
    thigh = (positions[:, roles["left_shin"]] - positions[:, roles["left_thigh"]]).norm(dim=-1)
    in_order = (feet[:, 2] < hips[:, 2]) & (hips[:, 2] < head[:, 2])
    return float((in_order & (head[:, 2] - feet[:, 2] > HEAD_HEIGHT * thigh)).float().mean())


def _one_side(positions: Tensor, roles: Mapping[str, int]) -> float:
    hips, shoulders = (
        positions[:, roles[f"left_{part}"]] - positions[:, roles[f"right_{part}"]]
        for part in ("thigh", "upper_arm")
    )
    return float(((hips * shoulders).sum(-1) > 0).float().mean())


def _bending_forwards(clip: Clip, positions: Tensor, roles: Mapping[str, int]) -> float:
    """Share of the bent knees that bend forwards, 1 where none is bent.

    In the axes of each thigh: someone who sits cross-legged has turned them outwards.
    """
    heads = clip.skeleton.heads
    left = unit(heads[roles["left_thigh"]] - heads[roles["right_thigh"]])
    forwards: list[Tensor] = []
    for side in ("left", "right"):
        thigh, shin, foot = (roles[f"{side}_{part}"] for part in ("thigh", "shin", "foot"))
        calf = rotate_back(clip.rotations[:, thigh], (positions[:, foot] - positions[:, shin]).to(heads))
        hinge = torch.linalg.cross(unit(heads[shin] - heads[thigh]).expand_as(calf), unit(calf))
        bent = hinge.norm(dim=-1) > BENT
        forwards.append((hinge @ left)[bent] > 0)
    bends = torch.cat(forwards)
    return float(bends.float().mean()) if len(bends) else 1.0
