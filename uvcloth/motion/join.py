"""Motions joined end to end: one fades into another that goes on from where it is and faces."""

from dataclasses import replace

import torch
from torch import Tensor

from uvcloth.geometry.rotations import from_axis_angles, heading, to_axis_angles
from uvcloth.motion.clip import Clip


def join_clips(first: Clip, second: Clip, seconds: float) -> Clip:
    """The first clip, and from its last `seconds` on the second: one fades into the other.

    The second is turned about the vertical and moved along the ground so that in the middle of the fade both
    have one heading and one place. The fade is shorter where a clip is. Both are of one skeleton and frame
    rate.
    """
    fade = max(min(round(seconds * first.fps), len(first) - 1, len(second) - 1), 1)
    last, start = first.window(len(first) - fade, fade), second.window(0, fade)
    middle = fade // 2
    turn = heading(last.rotations[middle, 0]) @ heading(start.rotations[middle, 0]).mT
    way = last.translation[middle] - turn.to(start.translation) @ start.translation[middle]
    way[2] = 0.0
    rotations = turn @ second.rotations
    translation = second.translation @ turn.to(second.translation).mT + way
    share = fading(fade)
    change = to_axis_angles(last.rotations.mT @ rotations[:fade])
    turned = last.rotations @ from_axis_angles(share[:, None, None] * change)
    path = torch.lerp(last.translation, translation[:fade], share.to(translation)[:, None])
    whole = len(first) - fade
    return replace(
        first,
        rotations=torch.cat([first.rotations[:whole], turned, rotations[fade:]]),
        translation=torch.cat([first.translation[:whole], path, translation[fade:]]),
    )


def fading(frames: int) -> Tensor:
    """Shares (frames,) that rise from 0 to 1, at both ends without velocity or acceleration."""
    t = torch.arange(1, frames + 1).float() / (frames + 1)
    return t**3 * (10 - 15 * t + 6 * t**2)
