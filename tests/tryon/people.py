"""Keypoints of our body before a known camera, as a detector would write them."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.rotations import from_euler
from uvcloth.motion.clip import Clip
from uvcloth.tryon.keypoints import BODY_25
from uvcloth.tryon.landmarks import landmarks, posed_landmarks

SIZE, VIEW, DEPTH = (720, 960), 45.0, 3.2


def pictured(clip: Clip, frame: int, turn: float, body: Body) -> tuple[Tensor, Tensor]:
    """Joint transforms (1, J, 3, 4) before a camera at the origin that looks along Y, and pixels (25, 2)."""
    turned = from_euler("z", torch.tensor([turn]))
    place = torch.tensor([[0.1, DEPTH, -0.1]])
    transforms = Clip("", clip.skeleton, turned @ clip.rotations[frame : frame + 1], place, 30.0).transforms()
    x, y, z = posed_landmarks(*landmarks(body, BODY_25), transforms)[0].unbind(-1)
    focal = SIZE[1] / 2 / math.tan(math.radians(VIEW / 2))
    return transforms, torch.stack([SIZE[0] / 2 + focal * x / y, SIZE[1] / 2 - focal * z / y], dim=1)


def openpose(points: Tensor, missing: Sequence[str] = ()) -> dict:
    """OpenPose's document of a person with 25 keypoints (25, 2)."""
    numbers: list[float] = []
    for name, (x, y) in zip(BODY_25, points.tolist(), strict=True):
        numbers += [0.0, 0.0, 0.0] if name in missing else [x, y, 0.9]
    return {"version": 1.3, "people": [{"pose_keypoints_2d": numbers}]}
