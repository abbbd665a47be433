"""Mirror images of poses."""

import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.geometry.skeleton import Skeleton

SIDE_PREFIXES = (("Left", "Right"), ("left", "right"), ("L", "R"))
"""Beginnings of joint names on either side, after a prefix like "mixamorig:"."""


def mirror_transforms(transforms: Tensor, skeleton: Skeleton) -> Tensor:
    """Mirror a pose across x = 0: left and right joints change places.

    transforms: (B, J, 3, 3) world rotations relative to the rest pose, or (B, J, 3, 4) with translations.

    Raises InputError naming a joint whose counterpart the skeleton lacks.
    """
    flip = torch.tensor([-1.0, 1.0, 1.0, 1.0]).to(transforms)
    return transforms[:, counterparts(skeleton)] * flip[:3, None] * flip[: transforms.shape[-1]]


def counterparts(skeleton: Skeleton) -> list[int]:
    """Index of each joint's counterpart on the other side, or of itself where it is on neither.

    Raises InputError naming a joint whose counterpart the skeleton lacks.
    """
    return [_counterpart(name, skeleton.names) for name in skeleton.names]


def _counterpart(name: str, names: tuple[str, ...]) -> int:
    """Index of the joint on the other side, or of the joint itself if it is on neither."""
    prefix, colon, plain = name.rpartition(":")
    for left, right in (*SIDE_PREFIXES, *(side[::-1] for side in SIDE_PREFIXES)):
        rest = plain.removeprefix(left)
        # "L" begins LowerBack as well as LThumb.
        if rest == plain or not (rest[:1].isupper() or rest.startswith("_")):
            continue
        other = f"{prefix}{colon}{right}{rest}"
        if other not in names:
            raise InputError(f"joint {name}: the skeleton has no {other} to mirror it to (use --no-mirror)")
        return names.index(other)
    return names.index(name)
