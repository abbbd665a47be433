"""Skeletons and forward kinematics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.geometry.roles import joint_roles

MOST_JOINTS = 2000
"""Limit for a skeleton in a file; film characters with faces have about 1,500."""

LONGEST_NAME = 256
"""Limit for the characters of a joint's name in a file."""


@dataclass(frozen=True)
class Skeleton:
    """Joints in an order in which every parent comes before its children.

    names: J joint names. parents: J indices, -1 for the root. heads: (J, 3) joint positions at rest, metres.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    heads: Tensor

    @cached_property
    def roles(self) -> Mapping[str, int]:
        """Index of the joint that plays each role, as `joint_roles` reads the names."""
        return joint_roles(self.names)

    def branch(self, joint: int) -> list[int]:
        """A joint and all joints below it, in their order."""
        below = {joint}
        for child, parent in enumerate(self.parents):
            if parent in below:
                below.add(child)
        return sorted(below)


def check_joints(path: Path, names: Sequence[str]) -> None:
    """Raise InputError naming the file of a skeleton of more than MOST_JOINTS, or with a name longer than
    LONGEST_NAME.
    """
    if len(names) > MOST_JOINTS:
        raise InputError(f"{path}: has more than {MOST_JOINTS:,} joints, which is the limit")
    if max(map(len, names), default=0) > LONGEST_NAME:
        raise InputError(f"{path}: a joint's name is longer than {LONGEST_NAME} characters")


def in_order(parents: Sequence[int]) -> bool:
    """Test that every joint comes after its parent."""
    return all(-1 <= parent < joint for joint, parent in enumerate(parents))


def joint_transforms(skeleton: Skeleton, rotations: Tensor, translation: Tensor) -> Tensor:
    """Forward kinematics from world rotations relative to the rest pose.

    rotations: (B, J, 3, 3), translation: (B, 3) world position of the root joint, metres.
    Returns (B, J, 3, 4): each takes a point at rest, rigidly attached to joint j, to its posed position.
    """
    heads = skeleton.heads.to(rotations)
    posed: list[Tensor] = []
    for joint, parent in enumerate(skeleton.parents):
        if parent < 0:
            posed.append(translation)
        else:
            bone = heads[joint] - heads[parent]
            posed.append(posed[parent] + rotations[:, parent] @ bone)
    origin = torch.stack(posed, dim=1) - (rotations @ heads[:, :, None]).squeeze(-1)
    return torch.cat([rotations, origin[..., None]], dim=-1)


def joint_positions(skeleton: Skeleton, transforms: Tensor) -> Tensor:
    """Positions (B, J, 3) of joints, each moved by its own of the transforms (B, J, 3, 4) from rest."""
    return (transforms[..., :3] @ skeleton.heads.to(transforms)[..., None]).squeeze(-1) + transforms[..., 3]


def local_rotations(parents: Sequence[int], rotations: Tensor) -> Tensor:
    """World rotations (B, J, 3, 3) -> each relative to its parent's; the root's stay as they are."""
    above = torch.tensor(parents, device=rotations.device)
    local = rotations[:, above.clamp(min=0)].mT @ rotations
    return torch.where((above < 0)[:, None, None], rotations, local)


def world_rotations(parents: Sequence[int], local: Tensor) -> Tensor:
    """Rotations (B, J, 3, 3) relative to the parent's -> world rotations."""
    world: list[Tensor] = []
    for joint, parent in enumerate(parents):
        world.append(world[parent] @ local[:, joint] if parent >= 0 else local[:, joint])
    return torch.stack(world, dim=1)
