"""AMASS: motion capture as poses of SMPL-H, in newer files of SMPL-X, one npz per motion.

Mahmood et al., "AMASS: Archive of Motion Capture as Surface Shapes", 2019. World Z up, metres; rotations are
axis-angles relative to the parents, from the model's zero pose, a T in axes with Y up, facing +Z.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.smpl_joints import FACE, HANDS, SMPL_JOINTS, STANDING, TRUNK_AND_LIMBS
from uvcloth.errors import InputError
from uvcloth.files.archive import list_arrays, read_arrays
from uvcloth.files.fields import MOST
from uvcloth.geometry.rotations import from_axis_angles
from uvcloth.geometry.skeleton import Skeleton, world_rotations
from uvcloth.motion.clip import Clip
from uvcloth.motion.options import FPS_RANGE
from uvcloth.motion.retarget import on_floor, resample

EXPECTED = (
    "a clip saved by uvcloth or a motion of AMASS (poses or root_orient and pose_body, trans, frame rate)"
)

RATES = ("mocap_framerate", "mocap_frame_rate")
PARTS = {
    "root_orient": TRUNK_AND_LIMBS[:1],
    "pose_body": TRUNK_AND_LIMBS[1:],
    "pose_jaw": FACE[:1],
    "pose_eye": FACE[1:],
    "pose_hand": HANDS,
}
"""Arrays of newer files, and the joints whose axis-angles each holds."""

FIELDS = ("poses", "trans", *RATES, *PARTS)

PARENTS = {
    "spine1": "pelvis", "spine2": "spine1", "spine3": "spine2", "neck": "spine3", "head": "neck",
    "hip": "pelvis", "knee": "hip", "ankle": "knee", "foot": "ankle",
    "collar": "spine3", "shoulder": "collar", "elbow": "shoulder", "wrist": "elbow", "hand": "wrist",
    "jaw": "head", "eye_smplhf": "head",
}  # fmt: skip
"""Parent of each joint, without sides."""

OFFSETS = {
    "spine1": (0.0, 0.11, -0.02), "spine2": (0.0, 0.13, 0.02), "spine3": (0.0, 0.06, 0.01),
    "neck": (0.0, 0.2, -0.03), "head": (0.0, 0.09, 0.04), "hip": (0.08, -0.09, 0.0),
    "knee": (0.02, -0.4, 0.0), "ankle": (0.0, -0.41, -0.02), "foot": (0.02, -0.06, 0.12),
    "collar": (0.08, 0.1, -0.02), "shoulder": (0.1, 0.04, -0.01), "elbow": (0.27, 0.0, 0.0),
    "wrist": (0.26, 0.0, 0.0), "hand": (0.08, 0.0, 0.0), "jaw": (0.0, 0.0, 0.02),
    "eye_smplhf": (0.03, 0.07, 0.07),
}  # fmt: skip
"""Offset of each joint, of the left side, from its parent, metres, for an adult in a T: Y up, facing +Z.

Files hold no skeleton: its lengths depend on a model file. Other bodies need only the directions, and the leg
length, which scales the root's path.
"""

FINGER_OFFSETS = {"1": (0.1, -0.01, 0.0), "2": (0.03, 0.0, 0.0), "3": (0.025, 0.0, 0.0)}


def is_amass(path: Path) -> bool:
    """Test for an npz with the fields of AMASS. Raises InputError if it cannot be read."""
    return bool({"poses", "pose_body", "trans", "betas"} & set(list_arrays(path, EXPECTED)))


def read_amass(path: Path) -> Clip:
    """Read a motion of AMASS, with its old field names or its new ones, at its own frame rate.

    The clip is in metres, Z up; its rest pose is the T, facing -Y, of a person of usual size with the joints
    that the file moves: those of SMPL, SMPL-H or SMPL-X, or these without hands. Shape, gender and soft
    tissue (dmpls) are not read.
    Raises InputError naming the file and the field if it is damaged, lacks one (as files of a shape alone
    do), holds another number of joints, no frames, a value that is not finite, or a pickled array.
    """
    path = Path(path)
    arrays = read_arrays(path, EXPECTED, FIELDS)
    names, turns = _turns(path, arrays)
    trans = _floats(path, "trans", arrays)
    if trans.shape != (len(turns), 3):
        raise InputError(
            f"{path}: trans has the shape {trans.shape}, expected ({len(turns)}, 3) as the poses"
        )
    if len(turns) == 0:
        raise InputError(f"{path}: has no frames")
    skeleton = zero_pose(names)
    standing = _standing()
    local = from_axis_angles(torch.from_numpy(turns))
    rotations = world_rotations(skeleton.parents, local) @ standing.mT
    # SMPL turns the body about its pelvis, which lies off the origin that trans moves, in the model's axes.
    pelvis = standing.mT @ skeleton.heads[0].double()
    return Clip(path.stem, skeleton, rotations.float(), torch.from_numpy(trans) + pelvis, _fps(path, arrays))


def zero_pose(names: tuple[str, ...]) -> Skeleton:
    """Skeleton of a person of usual size in the T of SMPL, by SMPL's names: Z up, facing -Y, metres."""
    heads: list[Tensor] = []
    parents: list[int] = []
    for name in names:
        above, offset = _above(name)
        parents.append(names.index(above) if above else -1)
        heads.append(torch.tensor(offset) + heads[parents[-1]] if above else torch.tensor((0.0, -0.2, 0.02)))
    return Skeleton(names, tuple(parents), torch.stack(heads) @ _standing().float().T)


def fits_unchanged(clip: Clip, body: Body) -> bool:
    """Test for a clip of AMASS, relative to its zero pose, and a body with the joints of an SMPL model."""
    names = clip.skeleton.names
    if body.skeleton.names not in SMPL_JOINTS.values() or names[: len(TRUNK_AND_LIMBS)] != TRUNK_AND_LIMBS:
        return False
    return torch.equal(clip.skeleton.heads, zero_pose(names).heads)


def carried_over(clip: Clip, body: Body, fps: float) -> Clip:
    """Put a motion of AMASS on an SMPL body: rotations unchanged, resampled, feet on the floor z = 0.

    Joints that the motion lacks move with their parents; those that the body lacks are left out.
    fps: frames per second of the result; raises InputError as `resample` does.
    """
    clip = resample(clip, fps)
    names = clip.skeleton.names
    turned: list[Tensor] = []
    for name, parent in zip(body.skeleton.names, body.skeleton.parents, strict=True):
        turned.append(clip.rotations[:, names.index(name)] if name in names else turned[parent])
    offset = _standing().float().mT @ (body.skeleton.heads[0] - clip.skeleton.heads[0])
    result = replace(
        clip,
        skeleton=body.skeleton,
        rotations=torch.stack(turned, dim=1),
        translation=clip.translation + offset,
    )
    return on_floor(result, body)


def _standing() -> Tensor:
    """Rotation (3, 3), float64, from Y up, facing +Z, to Z up, facing -Y."""
    return from_axis_angles(torch.tensor(STANDING, dtype=torch.float64))


def _turns(path: Path, arrays: Mapping[str, np.ndarray]) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the joints that a file moves, and their axis-angles (F, J, 3)."""
    if "poses" in arrays:
        poses = _floats(path, "poses", arrays)
        width = poses.shape[1] if poses.ndim == 2 else 0
        names = next((names for names in SMPL_JOINTS.values() if 3 * len(names) == width), None)
        if names is None:
            kinds = ", ".join(f"{3 * len(names)} ({kind})" for kind, names in SMPL_JOINTS.items())
            raise InputError(
                f"{path}: poses has the shape {poses.shape}, expected (F, N) with N one of {kinds}"
            )
        return names, poses.reshape(len(poses), len(names), 3)
    missing = [name for name in ("root_orient", "pose_body") if name not in arrays]
    if missing:
        raise InputError(f"{path}: holds no poses, lacks {', '.join(missing)}, expected {EXPECTED}")
    held: dict[str, np.ndarray] = {}
    for part, joints in PARTS.items():
        if part in arrays:
            values = _floats(path, part, arrays)
            frames = arrays["root_orient"].shape[0] if arrays["root_orient"].ndim else 0
            if values.shape != (frames, 3 * len(joints)):
                raise InputError(
                    f"{path}: {part} has the shape {values.shape}, expected ({frames}, {3 * len(joints)})"
                )
            held |= dict(zip(joints, np.moveaxis(values.reshape(frames, len(joints), 3), 1, 0), strict=True))
    return tuple(held), np.stack(list(held.values()), axis=1)


def _floats(path: Path, name: str, arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    if name not in arrays:
        raise InputError(f"{path}: lacks {name}, expected {EXPECTED}")
    if arrays[name].dtype.kind not in "fiu":
        raise InputError(f"{path}: {name} holds no numbers")
    values = arrays[name].astype(np.float64)
    usual = np.abs(values) <= MOST
    if not usual.all():
        bad = f" in frame {int(np.argwhere(~usual)[0][0])}" if values.ndim > 1 else ""
        raise InputError(f"{path}: {name} holds a value that is not a finite number{bad}")
    return values


def _fps(path: Path, arrays: Mapping[str, np.ndarray]) -> float:
    name = next((rate for rate in RATES if rate in arrays), RATES[0])
    rate = _floats(path, name, arrays)
    if rate.size != 1 or not FPS_RANGE[0] <= float(rate.item()) <= FPS_RANGE[1]:
        least, greatest = FPS_RANGE
        raise InputError(
            f"{path}: {name} is {rate.tolist()}, expected {least:g} to {greatest:g} frames per second"
        )
    return float(rate.item())


def _above(name: str) -> tuple[str, tuple[float, float, float]]:
    """Parent of a joint, "" for the pelvis, and the offset from it, metres, Y up."""
    if name == "pelvis":
        return "", (0.0, 0.0, 0.0)
    side, _, part = name.partition("_")
    if name in HANDS:
        above = f"{side}_wrist" if name[-1] == "1" else f"{name[:-1]}{int(name[-1]) - 1}"
        x, y, z = FINGER_OFFSETS[name[-1]]
    else:
        above = PARENTS[part or name]
        x, y, z = OFFSETS[part or name]
        above = above if not part or above in TRUNK_AND_LIMBS else f"{side}_{above}"
    return above, (-x if side == "right" else x, y, z)
