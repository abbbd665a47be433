"""The motion of packed sequences: once for all garments of a clip, as rotations and the path of the root."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.folder import MOTIONS
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.files.atomic import make_folder
from uvcloth.files.fields import check_fields, indices, numbers, whole
from uvcloth.formats.entropy import AXES, decode, encode
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.rotations import are_unit, from_quaternions, to_quaternions
from uvcloth.geometry.skeleton import (
    Skeleton,
    joint_positions,
    joint_transforms,
    local_rotations,
    world_rotations,
)
from uvcloth.motion.options import FPS_RANGE

MOTION_FORMAT = "uvcloth-packed-motion-2"
EXPECTED_MOTION = "the motion of packed sequences"

MOTION_STEP = 5e-5
"""Step of the packed motion, in metres and in components of quaternions (half radians)."""

NAME_LENGTH = 16
"""Hexadecimal digits of a motion's name, the hash of its file's contents."""

MOST_FRAMES = 100_000

FIELDS = {
    "code": whole("B", most=255, dtype=np.uint8),
    "frames": whole(least=1, most=MOST_FRAMES),
    "fps": numbers(least=FPS_RANGE[0], most=FPS_RANGE[1], dtype=np.float64),
    "warm_up": indices(of="F"),
}
"""Arrays of a motion's file. code: the second differences in time, in steps, coded by `formats.entropy`, of
the quaternions of all joints relative to their parents, and of the position of the root.
"""


@dataclass(frozen=True)
class PackedMotion:
    """Unpacked motion: transforms (F, J, 3, 4) of a body's joints, and fps and warm_up of a sequence."""

    transforms: Tensor
    fps: float
    warm_up: int


def keep_motion(clip: SimulatedClip, skeleton: Skeleton, folder: Path) -> str:
    """Write the motion of a clip into a packed folder, unless it is there; returns its name.

    Raises ValueError for motion that is too fast to be packed, InputError if it cannot be written.
    """
    code = encode(_differences(clip.transforms, skeleton), stride=1)
    arrays = {
        "code": code,
        "frames": np.array(len(clip.transforms), dtype=np.int64),
        "fps": np.array(clip.fps, dtype=np.float64),
        "warm_up": np.array(clip.warm_up, dtype=np.int64),
    }
    name = fingerprint(*(values.tobytes() for values in arrays.values()))[:NAME_LENGTH]
    path = folder / MOTIONS / f"{name}.npz"
    if not path.exists():
        make_folder(path.parent)
        save_arrays(path, {"format": np.array(MOTION_FORMAT), **arrays})
    return name


def load_motion(folder: Path, name: str, skeleton: Skeleton) -> PackedMotion:
    """Read a motion of a packed folder.

    Raises InputError naming the file if it is not a packed motion, or has another skeleton.
    """
    path = folder / MOTIONS / f"{name}.npz"
    arrays = load_arrays(path, MOTION_FORMAT, EXPECTED_MOTION)
    frames = int(check_fields(path, arrays, {"frames": FIELDS["frames"]})["frames"])
    data = check_fields(path, arrays, FIELDS, F=frames)
    joints = len(skeleton.names)
    try:
        steps = decode(data["code"], (frames, _rows(joints), AXES), stride=1)
    except ValueError as error:
        raise InputError(
            f"{path}: its {error}, expected the code of {frames} frames of {joints} joints"
        ) from error
    numbers = torch.from_numpy(steps.cumsum(axis=0).cumsum(axis=0) * MOTION_STEP).flatten(1)
    quaternions, places = numbers[:, : 4 * joints].unflatten(1, (-1, 4)), numbers[:, 4 * joints :][:, :3]
    if not are_unit(quaternions):
        raise InputError(f"{path}: has a rotation that is not a unit quaternion")
    rotations = world_rotations(skeleton.parents, from_quaternions(quaternions))
    transforms = joint_transforms(skeleton, rotations, places).float()
    return PackedMotion(transforms, float(data["fps"]), int(data["warm_up"]))


def _rows(joints: int) -> int:
    """Rows of AXES numbers that hold four of each joint and the root's place."""
    return -(-(4 * joints + 3) // AXES)


def _differences(transforms: Tensor, skeleton: Skeleton) -> np.ndarray:
    """Second differences in time (F, rows, AXES), in steps, of joints' quaternions and the root's place."""
    local = local_rotations(skeleton.parents, transforms[..., :3].double())
    quaternions = to_quaternions(local)
    # Of q and -q, the same rotation, the one that is closer to that of the frame before.
    turns = (quaternions[1:] * quaternions[:-1]).sum(-1, keepdim=True)
    quaternions[1:] *= torch.where(turns < 0.0, -1.0, 1.0).cumprod(0)
    places = joint_positions(skeleton, transforms.double())[:, 0]
    numbers = torch.cat([quaternions.flatten(1), places], dim=1)
    joints = len(skeleton.names)
    padded = torch.nn.functional.pad(numbers, (0, AXES * _rows(joints) - numbers.shape[1]))
    steps = np.rint(padded.numpy() / MOTION_STEP).astype(np.int64)
    for _ in range(2):
        steps[1:] = np.diff(steps, axis=0)
    return steps.reshape(len(steps), -1, AXES)
