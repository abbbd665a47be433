"""Animation of a skeleton in glTF 2.0 files (.glb, .gltf, .vrm)."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.errors import InputError
from uvcloth.formats.gltf import Gltf, one_line, read_gltf
from uvcloth.formats.gltf_document import LARGEST
from uvcloth.formats.gltf_rig import (
    REST,
    SkinJoints,
    chain,
    compose,
    local_transform,
    parents_first,
    read_rig,
    worlds,
)
from uvcloth.motion.clip import Clip
from uvcloth.motion.hierarchy import Hierarchy, to_clip
from uvcloth.motion.roles import table_roles

FPS_RANGE = (30.0, 120.0)
"""Least and greatest rate at which keys are sampled, frames per second."""

SHEAR = 1e-4
"""Largest difference of an entry of a matrix times its transpose from the identity, for a rotation.

Also the least singular value of a sheared matrix that has a nearest rotation.
"""

SPARSEST, MOST_OF_FEW = 100, 1_000_000
"""Limit for the sampled transforms of nodes: so many for each value in the file, and so many more."""


def read_gltf_motion(path: Path, wanted: str | None = None) -> Clip:
    """Read an animation of the largest skin of a glTF file, as a clip in metres, Y up.

    wanted: name of the animation or its number, from 1, in `animation_names`; None for the first. The rest
    pose is the bind pose of the skin, in which its mesh was modelled; keys are sampled at their own rate, 30
    to 120 per second. Raises InputError naming the file if it has no skin or no such animation, and if the
    animation cannot be read.
    """
    file = read_gltf(path)
    above, skin = file.above, _largest_skin(file)
    rig = read_rig(file, skin)
    nodes = _moving_nodes(file, rig.nodes)
    animation = _choose(file, _animations(file, nodes), wanted)
    order = parents_first(nodes, above)
    times, fps = _times(file, animation, len(order))
    with np.errstate(all="ignore"):  # Results of broken keys are refused below.
        world = worlds(order, above, {node: _local(file, animation, node, times) for node in order})
        clip = to_clip(file.path.stem, _hierarchy(file, rig, world, fps))
    bones = dict(zip(rig.names, rig.bones, strict=True))
    return replace(clip, table=table_roles([bones[name] for name in clip.skeleton.names]))


def animation_names(path: Path) -> list[str]:
    """Names of the animations of the largest skin of a glTF file, "" for one without a name.

    Raises InputError naming the file if it is not valid or has no skin.
    """
    file = read_gltf(path)
    nodes = _moving_nodes(file, _largest_skin(file)["joints"])
    return [_name(animation) for animation in _animations(file, nodes)]


def numbered(names: Sequence[str]) -> str:
    """The names of animations with their numbers from 1, in one line."""
    return ", ".join(f"{number} {name or '(no name)'}" for number, name in enumerate(names, start=1))


def _largest_skin(file: Gltf) -> dict[str, Any]:
    skin = max(file.entries("skins"), key=lambda entry: len(entry["joints"]), default=None)
    if skin is None:
        raise InputError(f"{file.path}: has no skin, and therefore no skeleton to move")
    return skin


def _moving_nodes(file: Gltf, joints: Iterable[int]) -> set[int]:
    """The joints and all their ancestors."""
    return {node for joint in joints for node in (joint, *chain(joint, file.above))}


def _animations(file: Gltf, nodes: set[int]) -> list[dict[str, Any]]:
    """Animations that move one of the nodes. Raises InputError if there are none."""
    animations = [
        entry
        for entry in file.entries("animations")
        if any(channel["target"].get("node") in nodes for channel in entry["channels"])
    ]
    if not animations:
        raise InputError(f"{file.path}: has no animation of its skeleton")
    return animations


def _choose(file: Gltf, animations: Sequence[dict[str, Any]], wanted: str | None) -> dict[str, Any]:
    if wanted is None:
        return animations[0]
    names = [_name(animation) for animation in animations]
    if names.count(wanted) == 1:
        return animations[names.index(wanted)]
    numbers = [str(number) for number in range(1, len(names) + 1)]
    if wanted not in numbers:
        raise InputError(f"{file.path}: --animation {wanted}: expected one of {numbered(names)}")
    return animations[numbers.index(wanted)]


def _name(animation: dict[str, Any]) -> str:
    return one_line(animation.get("name", ""))


def _hierarchy(file: Gltf, rig: SkinJoints, world: dict[int, np.ndarray], fps: float) -> Hierarchy:
    """Motion of the joints of a rig relative to their parents, given world transforms (T, 4, 4) of nodes."""
    if rig.parents.count(-1) != 1:
        raise InputError(f"{file.path}: the skin has {rig.parents.count(-1)} root joints, expected one")
    transforms = np.stack([world[node] for node in rig.nodes], axis=1)
    turned = _rotations(transforms) @ np.swapaxes(_rotations(rig.bind), 1, 2)
    turned, solid = _nearest_rotations(turned)
    bad = np.argwhere(~((np.abs(transforms).max(axis=(2, 3)) <= LARGEST) & solid))
    if len(bad):
        frame, joint = bad[0]
        raise InputError(
            f"{file.path}: frame {frame}, joint {rig.names[joint]}: not a rotation and translation, or "
            f"beyond {LARGEST:g}"
        )
    heads = rig.bind[:, :3, 3]
    rotations, positions, offsets = turned.copy(), transforms[..., :3, 3].copy(), heads.copy()
    for joint, parent in enumerate(rig.parents):
        if parent >= 0:
            back = np.swapaxes(turned[:, parent], 1, 2)
            rotations[:, joint] = back @ turned[:, joint]
            way = transforms[:, joint, :3, 3] - transforms[:, parent, :3, 3]
            positions[:, joint] = (back @ way[..., None]).squeeze(-1)
            offsets[joint] = heads[joint] - heads[parent]
    return Hierarchy(rig.names, rig.parents, offsets, rotations, positions, fps)


def _rotations(transforms: np.ndarray) -> np.ndarray:
    """Rotations of transforms (..., 4, 4) that turn, scale and move."""
    linear = transforms[..., :3, :3]
    return np.asarray(linear / np.linalg.norm(linear, axis=-2, keepdims=True))


def _nearest_rotations(linear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest rotations to (T, J, 3, 3), which parents' scales may shear, and a mask (T, J) of the valid."""
    rotations = linear.copy()
    finite = np.isfinite(linear).all(axis=(2, 3))
    sheared = finite & (np.abs(linear @ np.swapaxes(linear, 2, 3) - np.eye(3)).max(axis=(2, 3)) > SHEAR)
    left, size, right = np.linalg.svd(linear[sheared])
    rotations[sheared] = left @ right
    solid = finite & (np.linalg.det(np.where(finite[..., None, None], rotations, 0.0)) > 0)
    solid[sheared] &= size[:, 2] > SHEAR
    return rotations, solid


def _times(file: Gltf, animation: dict[str, Any], nodes: int) -> tuple[np.ndarray, float]:
    """Times (T,) of the frames, seconds, and their rate. Raises InputError for too few keys for `nodes`."""
    keys = np.unique(np.concatenate([_keys(file, sampler) for sampler in animation["samplers"]]))
    if not len(keys):
        raise InputError(f"{file.path}: the animation has no keys")
    steps = np.diff(keys)
    fps = float(np.clip(np.round(1.0 / np.median(steps)), *FPS_RANGE)) if len(steps) else FPS_RANGE[0]
    frames = int((keys[-1] - keys[0]) * fps + 1e-3) + 1
    outputs = {sampler["output"] for sampler in animation["samplers"]}
    held = sum(file.held(output) for output in outputs)
    if frames * nodes > SPARSEST * held + MOST_OF_FEW:
        raise InputError(
            f"{file.path}: the animation has {len(keys)} keys in {keys[-1] - keys[0]:.0f} s, too few for "
            "a motion"
        )
    return keys[0] + np.arange(frames) / fps, fps


def _keys(file: Gltf, sampler: dict[str, Any]) -> np.ndarray:
    """Times (K,) of the keys of a sampler, seconds."""
    keys = file.array(sampler["input"], "SCALAR")[:, 0].astype(np.float64)
    if (np.diff(keys) < 0).any() or not (np.abs(keys) <= LARGEST).all():
        raise InputError(f"{file.path}: the keys of the animation are not in order of time")
    return keys


def _local(file: Gltf, animation: dict[str, Any], index: int, times: np.ndarray) -> np.ndarray:
    """Transforms (T, 4, 4) of a node relative to its parent."""
    node = file.entries("nodes")[index]
    if "matrix" in node:
        return np.tile(local_transform(node), (len(times), 1, 1))
    values = {path: np.tile(np.array(node.get(path, rest)), (len(times), 1)) for path, rest in REST.items()}
    for channel in animation["channels"]:
        if channel["target"].get("node") == index and channel["target"]["path"] in REST:
            sampler = animation["samplers"][channel["sampler"]]
            kind = "VEC4" if channel["target"]["path"] == "rotation" else "VEC3"
            values[channel["target"]["path"]] = _sampled(file, sampler, kind, times)
    return compose(**values)


def _sampled(file: Gltf, sampler: dict[str, Any], kind: str, times: np.ndarray) -> np.ndarray:
    """Values of a sampler at times (T,): (T, 3) or, unit quaternions, (T, 4)."""
    keys = _keys(file, sampler)
    values = file.array(sampler["output"], kind).astype(np.float64)
    mode = sampler.get("interpolation", "LINEAR")
    if len(values) != len(keys) * (3 if mode == "CUBICSPLINE" else 1):
        raise InputError(
            f"{file.path}: a sampler of the animation has {len(keys)} keys but {len(values)} values"
        )
    tangents = None
    if mode == "CUBICSPLINE":
        values = values.reshape(len(keys), 3, -1)
        tangents, values = values[:, [0, 2]], values[:, 1]
    if kind == "VEC4" and not np.linalg.norm(values, axis=1).all():
        raise InputError(
            f"{file.path}: a rotation of the animation is 0, 0, 0, 0, expected a unit quaternion"
        )
    before = (np.searchsorted(keys, times, side="right") - 1).clip(0, len(keys) - 1)
    after = (before + 1).clip(max=len(keys) - 1)
    step = keys[after] - keys[before]
    share = ((times - keys[before]) / np.where(step > 0, step, 1.0)).clip(0.0, 1.0)[:, None]
    if mode == "STEP":
        share = np.floor(share)
    first, second = values[before], values[after]
    if tangents is not None:
        leaving, arriving = step[:, None] * tangents[before, 1], step[:, None] * tangents[after, 0]
        s, s2, s3 = share, share**2, share**3
        mixed = (2 * s3 - 3 * s2 + 1) * first + (s3 - 2 * s2 + s) * leaving
        mixed = mixed + (3 * s2 - 2 * s3) * second + (s3 - s2) * arriving
    elif values.shape[1] == 4:
        return _slerp(first, second, share)
    else:
        mixed = (1 - share) * first + share * second
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True) if values.shape[1] == 4 else mixed


def _slerp(first: np.ndarray, second: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Unit quaternions (T, 4) between two on the shorter way, share (T, 1)."""
    cosine = (first * second).sum(1, keepdims=True)
    second, angle = np.where(cosine < 0, -second, second), np.arccos(np.abs(cosine).clip(max=1.0))
    sine = np.sin(angle)
    close = sine < 1e-6
    weights = [np.sin(part * angle) / np.where(close, 1.0, sine) for part in (1 - share, share)]
    mixed = np.where(close, 1 - share, weights[0]) * first + np.where(close, share, weights[1]) * second
    return np.asarray(mixed / np.linalg.norm(mixed, axis=1, keepdims=True))
