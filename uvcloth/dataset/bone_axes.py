"""Axes that move with the bones near a garment: cloth moves less in them than in those of the root.

They depend only on the skeleton and the garment at rest, so that nothing has to be stored for them.
"""

import torch
from torch import Tensor

from uvcloth.geometry.rotations import rotate, rotate_back
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.geometry.skinning import skin_frames

BLUR = 0.15
"""Metres from a bone within which differences of distance hardly count."""

FALL = 3
"""Weights fall with the squared distance to the power of this."""


def bone_weights(points: Tensor, skeleton: Skeleton) -> Tensor:
    """Smooth blend weights (N, J), float64, of points (N, 3) m at rest, by their distances to the bones.

    A bone goes from its joint to the mean of the joint's children; without children it is the joint itself.
    """
    heads = skeleton.heads.double()
    above = torch.tensor(skeleton.parents)
    below = (above[None] == torch.arange(len(heads))[:, None]).double()
    counts = below.sum(1, keepdim=True)
    bones = torch.where(counts > 0, below @ heads / counts.clamp(min=1.0) - heads, 0.0)
    away = points.double()[:, None] - heads
    lengths = bones.square().sum(-1).clamp(min=1e-12)
    along = ((away * bones).sum(-1) / lengths).clamp(0.0, 1.0)
    distances = (away - along[..., None] * bones).square().sum(-1)
    weights = (distances + BLUR**2) ** -FALL
    return weights / weights.sum(1, keepdim=True)


def seen_from_bones(points: Tensor, rest: Tensor, skeleton: Skeleton, transforms: Tensor) -> Tensor:
    """Offsets (F, N, 3) m, float64, of moving points (F, N, 3) from points at rest (N, 3) that the bones
    move.

    Each is in axes that turn with the bones. transforms: (F, J, 3, 4).
    """
    origins, frames = skin_frames(rest.double(), bone_weights(rest, skeleton), transforms.double())
    return rotate_back(frames, points.double() - origins)


def moved_by_bones(offsets: Tensor, rest: Tensor, skeleton: Skeleton, transforms: Tensor) -> Tensor:
    """Points (F, N, 3) m, float64, from offsets in the axes of the bones; inverse of `seen_from_bones`."""
    origins, frames = skin_frames(rest.double(), bone_weights(rest, skeleton), transforms.double())
    return rotate(frames, offsets) + origins
