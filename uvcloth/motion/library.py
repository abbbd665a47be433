"""Loading of clips by path or name: BVH, glTF, FBX and AMASS files, clip archives, clips of the package."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import torch

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.files.fields import check_fields, indices, names, numbers
from uvcloth.geometry.once import once_per_record
from uvcloth.geometry.roles import read_role_map
from uvcloth.geometry.rotations import are_unit, from_quaternions, to_quaternions
from uvcloth.geometry.skeleton import Skeleton, in_order
from uvcloth.motion.amass import carried_over, fits_unchanged, is_amass, read_amass
from uvcloth.motion.arm_clearance import clear_arms
from uvcloth.motion.bvh import read_bvh
from uvcloth.motion.clip import Clip
from uvcloth.motion.gltf import ANIMATED, read_gltf_motion
from uvcloth.motion.guess import find_roles
from uvcloth.motion.options import FPS_RANGE, MotionOptions
from uvcloth.motion.posture import check_posture
from uvcloth.motion.rest import ZERO_POSE, ClipFromRest, find_rest
from uvcloth.motion.retarget import require_limbs, required_roles, retarget

LOGGER = logging.getLogger(__name__)

CLIP_FORMAT = "uvcloth-clip-1"
FIELDS = {
    "name": names(),
    "joint_names": names("J"),
    "joint_parents": indices("J", of="J", least=-1),
    "joint_heads": numbers("J", 3),
    "quaternions": numbers("T", "J", 4),
    "translation": numbers("T", 3),
    "fps": numbers(least=FPS_RANGE[0], most=FPS_RANGE[1], dtype=np.float64),
}
"""Arrays of a clip's file that are read: T frames, J joints."""


def builtin_clips() -> dict[str, Path]:
    """Files of the clips that ship with the package, by name, in alphabetical order."""
    folder = Path(str(files("uvcloth") / "data" / "clips"))
    return {path.stem: path for path in sorted(folder.glob("*.npz"))}


DEFAULTS = MotionOptions()

READERS: dict[str, Callable[[Path], Clip]] = {
    ".bvh": read_bvh,
    **dict.fromkeys(ANIMATED, read_gltf_motion),
}
"""Readers of motion files by suffix, besides that of clip archives."""


@dataclass(frozen=True)
class MotionSource:
    """A motion before it is retargeted: the clip as read, the roles of its joints, its standing rest pose."""

    clip: Clip
    roles: Mapping[str, int]
    rest: ClipFromRest


def load_clip(path_or_name: str | Path, body: Body, options: MotionOptions = DEFAULTS) -> Clip:
    """Load a motion retargeted onto a body, from a motion file or a built-in clip's name.

    Raises InputError naming the file for unreadable files, unknown joints, unknown names, a rest pose that
    cannot be determined, a frame rate outside FPS_RANGE, and a motion that no person can have made.
    """
    name, whole = str(path_or_name), replace(options, frames=DEFAULTS.frames, in_place=DEFAULTS.in_place)
    is_kept = name in builtin_clips() and options.joints is None
    clip = (_load_builtin if is_kept else _load_whole)(body, name, whole)
    try:
        return wanted_part(clip, options)
    except InputError as error:
        raise InputError(f"{path_or_name}: {error}") from error


def _load_whole(body: Body, name: str, options: MotionOptions) -> Clip:
    """All frames of the motion of a path or name, as `load_clip` says."""
    source = load_source(name, body, options)
    try:
        clip = motion_on_body(source, body, options)
        check_posture(clip, lying=options.up is not None or _up_is_known(Path(name), source.rest))
        return clip
    except InputError as error:
        raise InputError(f"{name}: {error}") from error


_load_builtin = once_per_record(_load_whole)


def _up_is_known(path: Path, rest: ClipFromRest) -> bool:
    """Test for a scene whose up axis, Y by its format, is that of a rest pose in the file."""
    return path.suffix.lower() in ANIMATED and rest.origin == ZERO_POSE and rest.up == "+y"


def wanted_part(clip: Clip, options: MotionOptions) -> Clip:
    """The frames of a clip that options select, in place if they say so. Raises InputError if none."""
    clip = clip.window(*options.window(len(clip)))
    if options.in_place:
        clip = replace(clip, translation=clip.translation * torch.tensor([0.0, 0.0, 1.0]))
    return clip


def load_source(path_or_name: str | Path, body: Body, options: MotionOptions = DEFAULTS) -> MotionSource:
    """Load a motion and find the roles of its joints and its rest pose; raises InputError as `load_clip`."""
    clip = read_motion(path_or_name, options.animation)
    try:
        named, guessed = clip_roles(clip, options)
        roles = required_roles(clip.skeleton, f"clip {clip.name}", named)
        require_limbs(clip.skeleton, roles)
        if guessed:
            LOGGER.warning(
                "%s: the names of its joints do not tell all roles, which are guessed from where the joints "
                "are at rest; `uvcloth motion` draws the guess, --joints corrects it",
                path_or_name,
            )
        return MotionSource(clip, roles, find_rest(clip, roles, body, options.up, options.rest_frame))
    except InputError as error:
        raise InputError(f"{path_or_name}: {error}") from error


def motion_on_body(source: MotionSource, body: Body, options: MotionOptions) -> Clip:
    """Put a motion on a body: unchanged rotations for AMASS on an SMPL body, otherwise retargeted, with arms
    kept out of torso and legs if the options say so.
    """
    if fits_unchanged(source.rest.clip, body):
        return carried_over(source.rest.clip, body, options.fps)
    clip = retarget(source.rest.clip, body, options.fps, source.roles)
    return clear_arms(clip, body) if options.clear_arms else clip


def clip_roles(clip: Clip, options: MotionOptions = DEFAULTS) -> tuple[dict[str, int], bool]:
    """Joint of each role in a clip, as the options, its file or its names say; and if it is guessed."""
    overrides = {} if options.joints is None else read_role_map(options.joints)
    return find_roles(clip.skeleton.names, clip.skeleton.parents, clip.skeleton.heads, overrides, clip.table)


def read_motion(path_or_name: str | Path, animation: str | None = None) -> Clip:
    """Read a motion file or a built-in clip on its own skeleton, in its own units and axes.

    animation: of a glTF or FBX file, by name or number. Raises InputError for another suffix, an unknown
    name, an animation of another file, and as the reader of the file does.
    """
    path = builtin_clips().get(str(path_or_name), Path(path_or_name))
    reader = (READERS | {".npz": read_archive}).get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{path_or_name}: expected a {', '.join(READERS)} or .npz file or one of the built-in clips "
            f"({', '.join(builtin_clips())})"
        )
    if animation is None:
        return reader(path)
    if path.suffix.lower() not in ANIMATED:
        raise InputError(
            f"{path_or_name}: --animation is for {', '.join(ANIMATED)}, this file holds one motion"
        )
    return read_gltf_motion(path, animation)


def read_archive(path: Path) -> Clip:
    """Read an npz: a motion of AMASS, or what `save_clip` wrote. Raises InputError as their readers do."""
    return read_amass(path) if is_amass(path) else read_clip(path)


def save_clip(clip: Clip, path: Path, notice: str = "") -> None:
    """Write a clip on its own skeleton to one npz; `notice` is a licence or an origin to keep with it.

    Raises InputError if it cannot be written.
    """
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

    Raises InputError naming the file, and the array, if it is missing, damaged, another format, without
    frames, or holds arrays that do not fit together, are out of range or not finite.
    """
    data = check_fields(path, load_arrays(path, CLIP_FORMAT, "a motion clip saved by uvcloth"), FIELDS)
    parents = tuple(data["joint_parents"].tolist())
    if not len(data["translation"]):
        raise InputError(f"{path}: the clip has zero frames")
    if not (parents and in_order(parents)):
        raise InputError(f"{path}: the clip has no joints, or one before its parent")
    quaternions = torch.from_numpy(data["quaternions"])
    if not are_unit(quaternions):
        raise InputError(f"{path}: a rotation of the clip is not a unit quaternion")
    skeleton = Skeleton(tuple(map(str, data["joint_names"])), parents, torch.from_numpy(data["joint_heads"]))
    return Clip(
        name=str(data["name"]),
        skeleton=skeleton,
        rotations=from_quaternions(quaternions.double()).float(),
        translation=torch.from_numpy(data["translation"]),
        fps=float(data["fps"]),
    )
