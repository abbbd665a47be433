"""Faults of motion capture that no cloth can follow: joints that jump, and joints that stand still."""

import math

import torch
from torch import Tensor

from uvcloth.geometry.skeleton import local_rotations
from uvcloth.motion.clip import Clip
from uvcloth.motion.retarget import joint_roles

WIDEST_TURN = 90.0
"""Degrees that a joint may turn in the world within a frame."""

SECONDS = 1.0
"""How long a joint may stand still relative to its parent while others move."""

UNMOVED = 1e-3
"""Degrees within which a joint stands still: far below what a captured joint trembles."""

WITHOUT_CLOTH = ("hand", "fingers", "toes")
"""Joints that no garment hangs on, whose captures flip most."""


def jump(clip: Clip, first: int = 0) -> str | None:
    """The first joint of a clip that turns by more than WIDEST_TURN in a frame, in words, if there is one.

    The clip is on a body's skeleton; its first frame is number `first`. Only joints that play a known role
    count, and not WITHOUT_CLOTH.
    """
    joints = _joints(clip)
    turns = _turns(clip.rotations[:, joints])
    wide = turns > WIDEST_TURN
    if not bool(wide.any()):
        return None
    frame = int(wide.any(1).int().argmax())
    joint = int(wide[frame].int().argmax())
    name, turn = clip.skeleton.names[joints[joint]], float(turns[frame, joint])
    return f"{name} turns by {turn:.0f} degrees in frame {first + frame + 1}"


def standstill(clip: Clip, first: int = 0) -> str | None:
    """The joint of a clip that stands still for SECONDS while others move, in words, if there is one.

    Joints count as in `jump`; one that never moves is one that the capture does not have.
    """
    joints = _joints(clip)
    moves = _turns(local_rotations(clip.skeleton.parents, clip.rotations)[:, joints]) > UNMOVED
    frozen = ~moves & moves.any(0) & moves.any(1, keepdim=True)
    for joint, still in zip(joints, frozen.T, strict=True):
        values, counts = torch.unique_consecutive(still, return_counts=True)
        lengths = torch.where(values, counts, 0)
        if len(lengths) and int(lengths.max()) >= round(SECONDS * clip.fps):
            longest = int(lengths.argmax())
            start = first + int(counts[:longest].sum())
            end = start + int(lengths[longest])
            return f"{clip.skeleton.names[joint]} stands still from frame {start} to {end} while others move"
    return None


def _joints(clip: Clip) -> list[int]:
    roles = joint_roles(clip.skeleton.names)
    return sorted(joint for role, joint in roles.items() if not role.endswith(WITHOUT_CLOTH))


def _turns(rotations: Tensor) -> Tensor:
    """Degrees between each rotation (T, J, 3, 3) and the next: (T - 1, J)."""
    turns = rotations[:-1].double().mT @ rotations[1:].double() - torch.eye(3, dtype=torch.float64)
    # The Frobenius norm of R - 1 is 2 sqrt(2) sin(angle / 2): exact for small angles, where the trace is not.
    return torch.rad2deg(2.0 * torch.asin((turns.flatten(-2).norm(dim=-1) / math.sqrt(8.0)).clamp(max=1.0)))
