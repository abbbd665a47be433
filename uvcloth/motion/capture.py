"""Faults of motion capture that cloth cannot follow: joints that jump, and joints that stand still."""

import math

import torch
from torch import Tensor

from uvcloth.geometry.skeleton import local_rotations
from uvcloth.motion.clip import Clip

MAX_FRAME_TURN = 90.0
"""Most degrees that a joint may turn in world axes from one frame to the next."""

STANDSTILL_SECONDS = 1.0
"""Seconds that a joint may stand still relative to its parent while others move."""

STANDSTILL_DEGREES = 1e-3
"""Degrees within which a joint stands still: far below the noise of a captured joint."""

WITHOUT_CLOTH = ("hand", "fingers", "toes")
"""Joints without garments, whose captures flip most."""


def find_jump(clip: Clip, first: int = 0) -> str | None:
    """Text on the first joint that turns by more than MAX_FRAME_TURN in a frame, or None.

    The clip is on a body's skeleton; its first frame is number `first`. Only joints that play a known role
    count, and not WITHOUT_CLOTH.
    """
    joints = _joints(clip)
    turns = _turns(clip.rotations[:, joints])
    wide = turns > MAX_FRAME_TURN
    if not bool(wide.any()):
        return None
    frame = int(wide.any(1).int().argmax())
    joint = int(wide[frame].int().argmax())
    name, turn = clip.skeleton.names[joints[joint]], float(turns[frame, joint])
    return f"{name} turns by {turn:.0f} degrees in frame {first + frame + 1}"


def find_standstill(clip: Clip, first: int = 0) -> str | None:
    """Text on the joint that stands still for STANDSTILL_SECONDS while others move, or None.

    Joints count as in `find_jump`. A joint that never moves does not count: the capture lacks it.
    """
    joints = _joints(clip)
    moves = _turns(local_rotations(clip.skeleton.parents, clip.rotations)[:, joints]) > STANDSTILL_DEGREES
    frozen = ~moves & moves.any(0) & moves.any(1, keepdim=True)
    for joint, still in zip(joints, frozen.T, strict=True):
        values, counts = torch.unique_consecutive(still, return_counts=True)
        lengths = torch.where(values, counts, 0)
        if len(lengths) and int(lengths.max()) >= round(STANDSTILL_SECONDS * clip.fps):
            longest = int(lengths.argmax())
            start = first + int(counts[:longest].sum())
            end = start + int(lengths[longest])
            return f"{clip.skeleton.names[joint]} stands still from frame {start} to {end} while others move"
    return None


def _joints(clip: Clip) -> list[int]:
    roles = clip.skeleton.roles
    return sorted(joint for role, joint in roles.items() if not role.endswith(WITHOUT_CLOTH))


def _turns(rotations: Tensor) -> Tensor:
    """Degrees between each rotation (T, J, 3, 3) and the next: (T - 1, J)."""
    turns = rotations[:-1].double().mT @ rotations[1:].double() - torch.eye(3, dtype=torch.float64)
    # The Frobenius norm of R - 1 is 2 sqrt(2) sin(angle / 2): exact for small angles, where the trace is not.
    return torch.rad2deg(2.0 * torch.asin((turns.flatten(-2).norm(dim=-1) / math.sqrt(8.0)).clamp(max=1.0)))
