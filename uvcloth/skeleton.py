"""Skeletons and forward kinematics."""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Skeleton:
    """Joints in an order in which every parent comes before its children.

    names: J joint names. parents: J indices, -1 for the root. heads: (J, 3) joint positions at rest, metres.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    heads: Tensor


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
