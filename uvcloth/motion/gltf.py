"""Animation of a skeleton in glTF 2.0 files (.glb, .gltf, .vrm)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from rasterize.errors import InputError
from uvcloth.geometry.gltf import Gltf, read_gltf
from uvcloth.geometry.rotations import from_quaternions
from uvcloth.motion.clip import Clip
from uvcloth.motion.hierarchy import Hierarchy, to_clip

FPS_RANGE = (30.0, 120.0)
"""Least and greatest rate that keys are sampled at, frames per second."""

REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
"""Of a node that says nothing, as the format has it."""


@dataclass(frozen=True)
class _Rig:
    """Joints of a skin: nodes, and their transforms (J, 4, 4) to the world in the bind pose."""

    nodes: list[int]
    bind: np.ndarray


def read_gltf_motion(path: Path) -> Clip:
    """Read the first animation of a glTF file that moves a skin, as a clip in metres, Y up.

    The rest pose is the bind pose of the skin, in which its mesh was modelled; keys are sampled at their own
    rate, 30 to 120 per second. Raises InputError naming the file if it has no skin or no animation, and if
    the animation cannot be read.
    """
    file = read_gltf(path)
    try:
        return _read(file)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise InputError(f"{path}: the glTF file cannot be understood ({error!r})") from error


def _read(file: Gltf) -> Clip:
    nodes = file.entries("nodes")
    above = {child: index for index, node in enumerate(nodes) for child in node.get("children", [])}
    skin = max(file.entries("skins"), key=lambda entry: len(entry["joints"]), default=None)
    if skin is None:
        raise InputError(f"{file.path}: has no skin, so no skeleton whose motion could be taken")
    moved = set(skin["joints"])
    for joint in skin["joints"]:
        moved |= set(_chain(joint, above))
    animation = next(
        (
            entry
            for entry in file.entries("animations")
            if any(channel["target"].get("node") in moved for channel in entry["channels"])
        ),
        None,
    )
    if animation is None:
        raise InputError(f"{file.path}: has no animation of its skeleton")
    order = _parents_first(sorted(moved), above)
    times, fps = _times(file, animation)
    world = _worlds(order, above, {node: _local(file, animation, node, times) for node in order})
    resting = _worlds(order, above, {node: _local(file, None, node, np.zeros(1)) for node in order})
    rig = _rig(file, skin, [node for node in order if node in set(skin["joints"])], resting)
    return to_clip(file.path.stem, _hierarchy(file, rig, above, world, fps))


def _hierarchy(
    file: Gltf, rig: _Rig, above: dict[int, int], world: dict[int, np.ndarray], fps: float
) -> Hierarchy:
    """Motion of the joints of a rig relative to their parents, given world transforms (T, 4, 4) of nodes."""
    number = {node: index for index, node in enumerate(rig.nodes)}
    parents = [_joint_above(node, above, number) for node in rig.nodes]
    if parents.count(-1) != 1:
        raise InputError(f"{file.path}: the skin has {parents.count(-1)} root joints, expected one")
    moved = np.stack([world[node] for node in rig.nodes], axis=1)
    turned = _rotations(moved) @ np.swapaxes(_rotations(rig.bind), 1, 2)
    heads = rig.bind[:, :3, 3]
    rotations, positions, offsets = turned.copy(), moved[..., :3, 3].copy(), heads.copy()
    for joint, parent in enumerate(parents):
        if parent >= 0:
            back = np.swapaxes(turned[:, parent], 1, 2)
            rotations[:, joint] = back @ turned[:, joint]
            way = moved[:, joint, :3, 3] - moved[:, parent, :3, 3]
            positions[:, joint] = (back @ way[..., None]).squeeze(-1)
            offsets[joint] = heads[joint] - heads[parent]
    names = [str(file.entries("nodes")[node].get("name", f"node {node}")) for node in rig.nodes]
    unique = tuple(name if names.count(name) == 1 else f"{name} {i}" for i, name in enumerate(names))
    return Hierarchy(unique, tuple(parents), offsets, rotations, positions, fps)


def _rig(file: Gltf, skin: dict[str, Any], joints: list[int], resting: dict[int, np.ndarray]) -> _Rig:
    """Joints in an order of parents before children, with their bind pose as it stands in the scene."""
    if "inverseBindMatrices" not in skin:
        return _Rig(joints, np.stack([resting[node][0] for node in joints]))
    inverse = file.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2).astype(np.float64)
    bind = np.linalg.inv(inverse[[skin["joints"].index(node) for node in joints]])
    # The mesh may be modelled in other axes and units than the scene has: the axes of the root joint tell.
    placing = resting[joints[0]][0] @ np.linalg.inv(bind[0])
    size = np.cbrt(np.linalg.det(placing[:3, :3]))
    axes = np.eye(4)
    axes[:3, :3] = size * _nearest_axes(placing[:3, :3] / size)
    return _Rig(joints, axes @ bind)


def _nearest_axes(rotation: np.ndarray) -> np.ndarray:
    """Rotation by right angles that is nearest to a rotation (3, 3), or that itself where none is near."""
    order = np.abs(rotation).argmax(0)
    axes = np.zeros((3, 3))
    axes[order, range(3)] = np.sign(rotation[order, range(3)])
    return axes if np.linalg.det(axes) > 0.5 else rotation


def _rotations(transforms: np.ndarray) -> np.ndarray:
    """Rotations of transforms (..., 4, 4) that turn, scale and move."""
    linear = transforms[..., :3, :3]
    return np.asarray(linear / np.linalg.norm(linear, axis=-2, keepdims=True))


def _chain(node: int, above: dict[int, int]) -> list[int]:
    """Nodes above a node, the nearest first."""
    chain: list[int] = []
    while node in above:
        node = above[node]
        chain.append(node)
    return chain


def _parents_first(nodes: list[int], above: dict[int, int]) -> list[int]:
    return sorted(nodes, key=lambda node: [*reversed(_chain(node, above)), node])


def _joint_above(node: int, above: dict[int, int], number: dict[int, int]) -> int:
    return next((number[other] for other in _chain(node, above) if other in number), -1)


def _worlds(order: list[int], above: dict[int, int], local: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """World transforms (T, 4, 4) by node."""
    world: dict[int, np.ndarray] = {}
    for node in order:
        world[node] = world[above[node]] @ local[node] if node in above else local[node]
    return world


def _times(file: Gltf, animation: dict[str, Any]) -> tuple[np.ndarray, float]:
    """Times (T,) of the frames, seconds, and their rate."""
    keys = np.unique(np.concatenate([file.array(s["input"])[:, 0] for s in animation["samplers"]]))
    steps = np.diff(keys.astype(np.float64))
    fps = float(np.clip(np.round(1.0 / np.median(steps)), *FPS_RANGE)) if len(steps) else FPS_RANGE[0]
    frames = int((keys[-1] - keys[0]) * fps + 1e-3) + 1
    return keys[0] + np.arange(frames) / fps, fps


def _local(file: Gltf, animation: dict[str, Any] | None, index: int, times: np.ndarray) -> np.ndarray:
    """Transforms (T, 4, 4) of a node relative to its parent; at rest without an animation."""
    node = file.entries("nodes")[index]
    if "matrix" in node:
        return np.tile(np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T, (len(times), 1, 1))
    values = {path: np.tile(np.array(node.get(path, rest)), (len(times), 1)) for path, rest in REST.items()}
    for channel in animation["channels"] if animation else []:
        if channel["target"].get("node") == index and channel["target"]["path"] in REST:
            sampler = animation["samplers"][channel["sampler"]] if animation else {}
            values[channel["target"]["path"]] = _sampled(file, sampler, times)
    local = np.tile(np.eye(4), (len(times), 1, 1))
    turned = from_quaternions(torch.from_numpy(values["rotation"].astype(np.float64))).numpy()
    local[:, :3, :3] = turned * values["scale"][:, None, :]
    local[:, :3, 3] = values["translation"]
    return local


def _sampled(file: Gltf, sampler: dict[str, Any], times: np.ndarray) -> np.ndarray:
    """Values of a sampler at times (T,): (T, 3) or, unit quaternions, (T, 4)."""
    keys = file.array(sampler["input"])[:, 0].astype(np.float64)
    values = file.array(sampler["output"]).astype(np.float64)
    mode = sampler.get("interpolation", "LINEAR")
    tangents = None
    if mode == "CUBICSPLINE":
        values = values.reshape(len(keys), 3, -1)
        tangents, values = values[:, [0, 2]], values[:, 1]
    if not np.isfinite(values).all():
        raise InputError(f"{file.path}: a key of the animation is not a finite number")
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
