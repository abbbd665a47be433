"""Lead-in: motion of the body from its rest pose into the clip, in front of the scored frames."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.rotations import from_axis_angles, heading, to_axis_angles
from uvcloth.motion.arm_clearance import clear_arms
from uvcloth.motion.clip import Clip
from uvcloth.motion.join import fading

HELD_FRAMES = 18
"""Frames for which a pose is held after the ramp, in which the body stands in it as well."""


@dataclass(frozen=True)
class LeadIn:
    """Numbers of frames: at rest, blending into the first pose, and accelerating to its velocity."""

    rest: int = 4
    blend: int = 24
    ramp: int = 12

    def __len__(self) -> int:
        return self.rest + self.blend + self.ramp


def lead_in(clip: Clip, body: Body, parts: LeadIn) -> Clip:
    """Put a start from rest in front of a clip: len(parts) more frames.

    The body stands at rest under its first position, facing its first heading. It blends smoothly into the
    first pose, moved back along the first frame's velocity, and reaches that velocity as the clip begins.
    Moved back, a swinging arm may get into torso or legs: `clear_arms` turns it out.
    """
    begin = clip.window(0, 2)
    straight = replace(
        begin,
        rotations=torch.cat([_rotations(clip, parts), begin.rotations]),
        translation=torch.cat([_translation(clip, body, parts), begin.translation]),
    )
    cleared = clear_arms(straight, body, held=len(begin)).window(0, len(parts))
    return replace(
        clip,
        rotations=torch.cat([cleared.rotations, clip.rotations]),
        translation=torch.cat([cleared.translation, clip.translation]),
    )


def pose_from_rest(clip: Clip, body: Body) -> Clip:
    """Put a lead-in before a clip of one frame, and hold its pose HELD_FRAMES; return others unchanged."""
    if len(clip) > 1:
        return clip
    posed = lead_in(clip, body, LeadIn())
    held = torch.tensor([*range(len(posed)), *[-1] * HELD_FRAMES])
    return replace(posed, rotations=posed.rotations[held], translation=posed.translation[held])


def _rotations(clip: Clip, parts: LeadIn) -> Tensor:
    """Rotations (len(parts), J, 3, 3)."""
    first, second = clip.rotations[0], clip.rotations[min(1, len(clip) - 1)]
    spin = to_axis_angles(second @ first.transpose(-1, -2))
    ramp = from_axis_angles(-_back(parts)[:, None, None] * spin) @ first
    facing = heading(clip.rotations[0, 0])
    turn = to_axis_angles(facing.transpose(-1, -2) @ ramp[0])
    blend = facing @ from_axis_angles(fading(parts.blend)[:, None, None] * turn)
    return torch.cat([facing.expand(parts.rest, len(clip.skeleton.names), 3, 3), blend, ramp])


def _translation(clip: Clip, body: Body, parts: LeadIn) -> Tensor:
    """Path (len(parts), 3) m of the root."""
    drift = clip.translation[min(1, len(clip) - 1)] - clip.translation[0]
    ramp = clip.translation[0] - _back(parts)[:, None] * drift
    height = float(clip.skeleton.heads[0, 2] - body.mesh.vertices[:, 2].min())
    start = torch.cat([ramp[0, :2], torch.tensor([height])])
    blend = start + fading(parts.blend)[:, None] * (ramp[0] - start)
    return torch.cat([start.expand(parts.rest, 3), blend, ramp])


def _back(parts: LeadIn) -> Tensor:
    """Frames (parts.ramp,) of motion by which the ramp is behind the clip."""
    u = torch.arange(parts.ramp, 0, -1).float() / parts.ramp
    return parts.ramp * (u - u**3 + 0.5 * u**4)
