"""Lead-in: motion of the body from its rest pose into the clip, in front of the scored frames."""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.rotations import from_axis_angles, to_axis_angles
from uvcloth.motion.clip import Clip

HELD_FRAMES = 18
"""Frames that a pose is held for, after those of the ramp, in which it stands as well."""


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

    The body stands at rest under its first position, facing its first heading, turns smoothly into the first
    pose moved back along the first frame's velocity, and reaches that velocity just as the clip begins.
    """
    first, second = clip.rotations[0], clip.rotations[min(1, len(clip) - 1)]
    spin = to_axis_angles(second @ first.transpose(-1, -2))
    drift = clip.translation[min(1, len(clip) - 1)] - clip.translation[0]
    u = torch.arange(parts.ramp, 0, -1).float() / parts.ramp
    back = parts.ramp * (u - u**3 + 0.5 * u**4)
    ramp_rotations = from_axis_angles(-back[:, None, None] * spin) @ first
    ramp_translation = clip.translation[0] - back[:, None] * drift

    heading = _heading(clip.rotations[0, 0])
    height = float(clip.skeleton.heads[0, 2] - body.mesh.vertices[:, 2].min())
    start = torch.cat([ramp_translation[0, :2], torch.tensor([height])])
    turn = to_axis_angles(heading.transpose(-1, -2) @ ramp_rotations[0])
    t = torch.arange(1, parts.blend + 1).float() / (parts.blend + 1)
    share = t**3 * (10 - 15 * t + 6 * t**2)
    blend_rotations = heading @ from_axis_angles(share[:, None, None] * turn)
    blend_translation = start + share[:, None] * (ramp_translation[0] - start)

    joints = len(clip.skeleton.names)
    rest_rotations = heading.expand(parts.rest, joints, 3, 3)
    rest_translation = start.expand(parts.rest, 3)
    return Clip(
        clip.name,
        clip.skeleton,
        torch.cat([rest_rotations, blend_rotations, ramp_rotations, clip.rotations]),
        torch.cat([rest_translation, blend_translation, ramp_translation, clip.translation]),
        clip.fps,
    )


def pose_from_rest(clip: Clip, body: Body) -> Clip:
    """Make a clip of one frame, a pose, the way into it from rest, held at the end; other clips stay."""
    if len(clip) > 1:
        return clip
    posed = lead_in(clip, body, LeadIn())
    held = torch.tensor([*range(len(posed)), *[-1] * HELD_FRAMES])
    return replace(posed, rotations=posed.rotations[held], translation=posed.translation[held])


def _heading(rotation: Tensor) -> Tensor:
    """Rotation about the vertical (3, 3) that is nearest to a rotation (3, 3)."""
    angle = math.atan2(float(rotation[1, 0] - rotation[0, 1]), float(rotation[0, 0] + rotation[1, 1]))
    c, s = math.cos(angle), math.sin(angle)
    return torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
