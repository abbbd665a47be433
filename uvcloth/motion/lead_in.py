"""Lead-in: motion of the body from its rest pose into the clip, in front of the scored frames."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.rotations import from_axis_angles, heading, to_axis_angles
from uvcloth.motion.arms import arm_depth
from uvcloth.motion.clip import Clip
from uvcloth.motion.join import fading

HELD_FRAMES = 18
"""Frames for which a pose is held after the ramp, in which the body stands in it as well."""

TURNING_SHARES = (1.0, 0.67, 0.42, 0.25, 0.0)
"""Shares of the ramp, counted from its end, in which joints turn, in the order tried."""

ARM_CLEARANCE = 0.02
"""Metres that bones of forearms and hands keep from the torso's skin if joints turn in fewer frames."""


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

    Moved back, a swinging arm may be inside the torso, where its sleeve comes off. If bones of a forearm or
    hand get inside, joints turn only in the last frames of the ramp: in the largest of TURNING_SHARES that
    keeps ARM_CLEARANCE, or the clearance of the clip's first frame if that is less. If none does, the share
    with the least depth is taken.
    """
    translation = _translation(clip, body, parts)
    tried: list[tuple[float, Tensor]] = []
    for share in TURNING_SHARES:
        rotations = _rotations(clip, parts, max(1, round(share * parts.ramp)))
        depth = _depth(_joined(rotations, translation, clip.window(0, 1)), body)
        allowed = depth[-1].clamp(min=-ARM_CLEARANCE if tried else 0.0)
        if (depth[:-1] <= allowed).all():
            return _joined(rotations, translation, clip)
        tried.append((float(depth[:-1].max()), rotations))
    return _joined(min(tried, key=lambda each: each[0])[1], translation, clip)


def pose_from_rest(clip: Clip, body: Body) -> Clip:
    """Put a lead-in before a clip of one frame, and hold its pose HELD_FRAMES; return others unchanged."""
    if len(clip) > 1:
        return clip
    posed = lead_in(clip, body, LeadIn())
    held = torch.tensor([*range(len(posed)), *[-1] * HELD_FRAMES])
    return replace(posed, rotations=posed.rotations[held], translation=posed.translation[held])


def _rotations(clip: Clip, parts: LeadIn, turning: int) -> Tensor:
    """Rotations (len(parts), J, 3, 3); turning: frames of the ramp in which joints turn."""
    first, second = clip.rotations[0], clip.rotations[min(1, len(clip) - 1)]
    spin = to_axis_angles(second @ first.transpose(-1, -2))
    ramp = from_axis_angles(-_back(parts, turning)[:, None, None] * spin) @ first
    facing = heading(clip.rotations[0, 0])
    turn = to_axis_angles(facing.transpose(-1, -2) @ ramp[0])
    blend = facing @ from_axis_angles(fading(parts.blend)[:, None, None] * turn)
    return torch.cat([facing.expand(parts.rest, len(clip.skeleton.names), 3, 3), blend, ramp])


def _translation(clip: Clip, body: Body, parts: LeadIn) -> Tensor:
    """Path (len(parts), 3) m of the root."""
    drift = clip.translation[min(1, len(clip) - 1)] - clip.translation[0]
    ramp = clip.translation[0] - _back(parts, parts.ramp)[:, None] * drift
    height = float(clip.skeleton.heads[0, 2] - body.mesh.vertices[:, 2].min())
    start = torch.cat([ramp[0, :2], torch.tensor([height])])
    blend = start + fading(parts.blend)[:, None] * (ramp[0] - start)
    return torch.cat([start.expand(parts.rest, 3), blend, ramp])


def _back(parts: LeadIn, last: int) -> Tensor:
    """Frames (parts.ramp,) of motion by which the ramp is behind the clip, if only the `last` ones move."""
    u = (torch.arange(parts.ramp, 0, -1).float() / last).clamp(max=1.0)
    return last * (u - u**3 + 0.5 * u**4)


def _joined(rotations: Tensor, translation: Tensor, clip: Clip) -> Clip:
    """The clip with frames in front of it."""
    return replace(
        clip,
        rotations=torch.cat([rotations, clip.rotations]),
        translation=torch.cat([translation, clip.translation]),
    )


def _depth(motion: Clip, body: Body) -> Tensor:
    """Arm depth (F, A) m as of `arm_depth`, computed near the origin for precision."""
    near = replace(motion, translation=motion.translation - motion.translation[:1])
    return arm_depth(body, near.transforms())
