"""Motion of a body as the network sees it: in the axes of its root, wherever it is and faces."""

import torch
from torch import Tensor

from uvcloth.geometry.rotations import rotate_back
from uvcloth.geometry.units import GRAVITY

PER_JOINT, OF_ROOT = 15, 6
"""Numbers for each joint, and for the root besides."""


def motion_size(joints: int) -> int:
    """Length C of the description of a skeleton's motion, of J joints."""
    return PER_JOINT * joints + OF_ROOT


def body_motion(transforms: Tensor, heads: Tensor, fps: Tensor | float) -> Tensor:
    """Motion (B, C) of B bodies in the last of three frames.

    transforms: (B, 3, J, 3, 4) of joints. heads: (J, 3) m, joints at rest. fps: frames per second. For each
    joint its first two axes, its angular velocity (rad/s), its velocity (m/s) and its acceleration less that
    of free fall (m/s2), backward differences; then gravity's direction and the root's angular velocity.
    """
    turns = transforms[..., :3]
    places = (turns @ heads[..., None]).squeeze(-1) + transforms[..., 3]
    velocities = (places[:, 1:] - places[:, :-1]) * fps
    up = transforms.new_tensor([0.0, 0.0, 1.0])
    felt = (velocities[:, 1] - velocities[:, 0]) * fps + GRAVITY * up
    change = turns[:, -1] @ turns[:, -2].transpose(-1, -2)
    skew = 0.5 * fps * (change - change.transpose(-1, -2))
    spin = torch.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], dim=-1)
    root = turns[:, -1, :1]
    joints = [
        (root.transpose(-1, -2) @ turns[:, -1])[..., :2].flatten(2),
        *(rotate_back(root, vectors) for vectors in (spin, velocities[:, 1], felt)),
    ]
    whole = [-rotate_back(root[:, 0], up.expand_as(spin[:, 0])), rotate_back(root[:, 0], spin[:, 0])]
    return torch.cat([torch.cat(joints, dim=2).flatten(1), *whole], dim=1)


def held_still(motion: Tensor) -> Tensor:
    """Motion (B, C) of bodies that stand still in the poses of others, (B, C)."""
    joints, down = motion[:, :-OF_ROOT].split(PER_JOINT, dim=1), motion[:, -OF_ROOT:-3]
    felt, none = -GRAVITY * down, torch.zeros_like(down)
    each = [part for joint in joints for part in (joint[:, :6], none, none, felt)]
    return torch.cat([*each, down, none], dim=1)
