"""Loading of clips by path or name: BVH files, clip archives, clips that ship with the package."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import torch

from rasterize.archive import load_arrays, save_arrays
from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.geometry.rotations import from_quaternions, to_quaternions
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.motion.bvh import read_bvh
from uvcloth.motion.clip import Clip
from uvcloth.motion.retarget import retarget

CLIP_FORMAT = "uvcloth-clip-1"


def builtin_clips() -> dict[str, Path]:
    """Files of the clips that ship with the package, by name, in alphabetical order."""
    folder = Path(str(files("uvcloth") / "data" / "clips"))
    return {path.stem: path for path in sorted(folder.glob("*.npz"))}


def load_clip(path_or_name: str | Path, body: Body, fps: float = 30.0) -> Clip:
    """Load a motion retargeted onto a body, from a BVH file, a clip archive (.npz) or a built-in clip's name.

    Raises InputError naming the file for unreadable files, unknown joints and unknown names.
    """
    path = builtin_clips().get(str(path_or_name), Path(path_or_name))
    suffix = path.suffix.lower()
    if suffix not in (".bvh", ".npz"):
        raise InputError(
            f"{path_or_name}: expected a .bvh or .npz file or one of the built-in clips "
            f"({', '.join(builtin_clips())})"
        )
    clip = read_bvh(path) if suffix == ".bvh" else read_clip(path)
    try:
        return retarget(clip, body, fps)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def save_clip(clip: Clip, path: Path, notice: str = "") -> None:
    """Write a clip on its own skeleton to one npz; `notice` is a licence or an origin to keep with it."""
    save_arrays(
        path,
        {
            "format": np.array(CLIP_FORMAT),
            "name": np.array(clip.name),
            "notice": np.array(notice),
            "joint_names": np.array(clip.skeleton.names),
            "joint_parents": np.array(clip.skeleton.parents, dtype=np.int16),
            "joint_heads": clip.skeleton.heads.numpy().astype(np.float32),
            "quaternions": to_quaternions(clip.rotations).float().numpy(),
            "translation": clip.translation.numpy().astype(np.float32),
            "fps": np.array(clip.fps),
        },
    )


def read_clip(path: Path) -> Clip:
    """Read what `save_clip` wrote: the clip on its own skeleton, in its own units and axes.

    Raises InputError naming the file if it is missing, truncated, another format, without frames, or
    holds arrays that do not fit together or are not finite.
    """
    data = load_arrays(path, CLIP_FORMAT, "a motion clip saved by uvcloth")
    try:
        names = tuple(str(name) for name in data["joint_names"])
        parents = tuple(int(parent) for parent in data["joint_parents"])
        heads, quaternions, translation = data["joint_heads"], data["quaternions"], data["translation"]
        fps, name = float(data["fps"]), str(data["name"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: the clip lacks a readable array {error}") from error
    joints, frames = len(names), len(translation)
    shapes = (heads.shape, quaternions.shape, translation.shape)
    if shapes != ((joints, 3), (frames, joints, 4), (frames, 3)) or len(parents) != joints:
        raise InputError(f"{path}: the clip's arrays do not fit together")
    if frames == 0:
        raise InputError(f"{path}: the clip has zero frames")
    if not all(parent < joint for joint, parent in enumerate(parents)) or not 0 < fps < np.inf:
        raise InputError(f"{path}: the clip's joint order or frame rate is not valid")
    for values, what in ((heads, "joint head"), (quaternions, "rotation"), (translation, "root position")):
        if not np.isfinite(values).all():
            raise InputError(f"{path}: a {what} of the clip is not a finite number")
    if not np.allclose(np.linalg.norm(quaternions, axis=-1), 1.0, atol=1e-3):
        raise InputError(f"{path}: a rotation of the clip is no unit quaternion")
    return Clip(
        name=name,
        skeleton=Skeleton(names, parents, torch.from_numpy(heads)),
        rotations=from_quaternions(torch.from_numpy(quaternions).double()).float(),
        translation=torch.from_numpy(translation),
        fps=fps,
    )
