"""Loading of clips by path or name: BVH, glTF and AMASS files, clip archives, clips of the package."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import torch

from rasterize.archive import load_arrays, save_arrays
from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.geometry.rotations import from_quaternions, to_quaternions
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.motion.amass import carried_over, fits_unchanged, is_amass, read_amass
from uvcloth.motion.bvh import read_bvh
from uvcloth.motion.clip import Clip
from uvcloth.motion.gltf import read_gltf_motion
from uvcloth.motion.options import MotionOptions
from uvcloth.motion.posture import check_posture
from uvcloth.motion.rest import Rest, find_rest
from uvcloth.motion.retarget import require_limbs, required_roles, retarget
from uvcloth.motion.roles import assign_roles, read_role_map

CLIP_FORMAT = "uvcloth-clip-1"


def builtin_clips() -> dict[str, Path]:
    """Files of the clips that ship with the package, by name, in alphabetical order."""
    folder = Path(str(files("uvcloth") / "data" / "clips"))
    return {path.stem: path for path in sorted(folder.glob("*.npz"))}


DEFAULTS = MotionOptions()

READERS: dict[str, Callable[[Path], Clip]] = {
    ".bvh": read_bvh,
    ".glb": read_gltf_motion,
    ".gltf": read_gltf_motion,
    ".vrm": read_gltf_motion,
}
"""Readers of motion files by suffix, besides that of clip archives."""


@dataclass(frozen=True)
class MotionSource:
    """A motion before it is retargeted: the clip as read, the roles of its joints, its standing rest pose."""

    clip: Clip
    roles: Mapping[str, int]
    rest: Rest


def load_clip(path_or_name: str | Path, body: Body, options: MotionOptions = DEFAULTS) -> Clip:
    """Load a motion retargeted onto a body, from a motion file or a built-in clip's name.

    Raises InputError naming the file for unreadable files, unknown joints, unknown names, a rest pose that
    cannot be told, and a motion that no person can have made.
    """
    source = load_source(path_or_name, body, options)
    try:
        clip = moved(source, body, options.fps)
        check_posture(clip, lying=options.up is not None)
        clip = clip.window(*options.window(len(clip)))
    except InputError as error:
        raise InputError(f"{path_or_name}: {error}") from error
    if options.in_place:
        clip = replace(clip, translation=clip.translation * torch.tensor([0.0, 0.0, 1.0]))
    return clip


def load_source(path_or_name: str | Path, body: Body, options: MotionOptions = DEFAULTS) -> MotionSource:
    """Load a motion and find the roles of its joints and its rest pose; raises InputError as `load_clip`."""
    clip = read_motion(path_or_name)
    try:
        roles = required_roles(clip.skeleton, f"clip {clip.name}", clip_roles(clip, options))
        require_limbs(clip.skeleton, roles)
        return MotionSource(clip, roles, find_rest(clip, roles, body, options.up, options.rest_frame))
    except InputError as error:
        raise InputError(f"{path_or_name}: {error}") from error


def moved(source: MotionSource, body: Body, fps: float) -> Clip:
    """A motion on a body: retargeted, but for one of AMASS on a body of SMPL's, whose joints it has."""
    if fits_unchanged(source.rest.clip, body):
        return carried_over(source.rest.clip, body, fps)
    return retarget(source.rest.clip, body, fps, source.roles)


def clip_roles(clip: Clip, options: MotionOptions = DEFAULTS) -> dict[str, int]:
    """Joint of each role that a clip's joints play, by name or as the options say."""
    chosen = {} if options.joints is None else read_role_map(options.joints)
    return assign_roles(clip.skeleton.names, chosen)


def read_motion(path_or_name: str | Path) -> Clip:
    """Read a motion file or a built-in clip on its own skeleton, in its own units and axes."""
    path = builtin_clips().get(str(path_or_name), Path(path_or_name))
    reader = (READERS | {".npz": read_archive}).get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{path_or_name}: expected a {', '.join(READERS)} or .npz file or one of the built-in clips "
            f"({', '.join(builtin_clips())})"
        )
    return reader(path)


def read_archive(path: Path) -> Clip:
    """Read an npz: a motion of AMASS, or what `save_clip` wrote. Raises InputError as their readers do."""
    return read_amass(path) if is_amass(path) else read_clip(path)


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
