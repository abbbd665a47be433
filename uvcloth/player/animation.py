"""Animations of glTF files, sampled at times: transforms of nodes to the world, for all frames at once."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from uvcloth.player.gltf_document import LARGEST
from uvcloth.player.gltf_file import GltfFile, one_line
from uvcloth.player.nodes import REST, chain, compose, local_transform, parents_first, worlds

FPS_RANGE = (30.0, 120.0)
"""Least and greatest rate at which keys are sampled, frames per second."""

SPARSEST, MOST_OF_FEW = 100, 1_000_000
"""Limit for the sampled transforms of nodes: so many for each value in the file, and so many more."""

STILL = 1e-6
"""Difference of the keys of a channel, over their largest value, up to which it moves nothing."""


def numbered(names: Sequence[str]) -> str:
    """The names of animations with their numbers from 1, in one line."""
    return ", ".join(f"{number} {name or '(no name)'}" for number, name in enumerate(names, start=1))


def moving_nodes(file: GltfFile, joints: Iterable[int]) -> set[int]:
    """The joints and all their ancestors."""
    return {node for joint in joints for node in (joint, *chain(joint, file.above))}


def animations_of(file: GltfFile, nodes: set[int]) -> list[dict[str, Any]]:
    """Animations that move one of the nodes. Raises ValueError if there are none."""
    animations = [
        entry
        for entry in file.entries("animations")
        if any(channel["target"].get("node") in nodes for channel in entry["channels"])
    ]
    if not animations:
        raise file.error("has no animation of its skeleton")
    return animations


def choose_animation(
    file: GltfFile, animations: Sequence[dict[str, Any]], wanted: str | None
) -> dict[str, Any]:
    """The animation of a name, or of a number from 1. Raises ValueError if none is.

    None for the first whose keys differ: exporters put one in front that only holds the rest pose.
    """
    if wanted is None:
        several = animations if len(animations) > 1 else ()
        return next((each for each in several if _differs(file, each)), animations[0])
    names = [animation_name(animation) for animation in animations]
    if names.count(wanted) == 1:
        return animations[names.index(wanted)]
    numbers = [str(number) for number in range(1, len(names) + 1)]
    if wanted not in numbers:
        raise file.error(f"--animation {wanted}: expected one of {numbered(names)}")
    return animations[numbers.index(wanted)]


def _differs(file: GltfFile, animation: dict[str, Any]) -> bool:
    """Test for an animation with a channel of REST whose keys differ."""
    for channel in animation["channels"]:
        kind = "VEC4" if channel["target"]["path"] == "rotation" else "VEC3"
        if channel["target"]["path"] in REST:
            sampler = animation["samplers"][channel["sampler"]]
            values = file.array(sampler["output"], kind)
            if sampler.get("interpolation") == "CUBICSPLINE":
                values = values[1::3]
            if len(values) and (np.ptp(values, axis=0) > STILL * np.abs(values).max()).any():
                return True
    return False


def animation_name(animation: dict[str, Any]) -> str:
    """Name of an animation, "" where it has none."""
    return one_line(animation.get("name", ""))


def frame_times(
    file: GltfFile, animation: dict[str, Any], nodes: int, fps: float | None = None
) -> tuple[np.ndarray, float]:
    """Times (T,) of the frames, seconds, and their rate.

    fps: of the frames, None for that of the keys. Raises ValueError for too few keys for `nodes`.
    """
    keys = np.unique(np.concatenate([_keys(file, sampler) for sampler in animation["samplers"]]))
    if not len(keys):
        raise file.error("the animation has no keys")
    steps = np.diff(keys)
    if fps is None:
        fps = float(np.clip(np.round(1.0 / np.median(steps)), *FPS_RANGE)) if len(steps) else FPS_RANGE[0]
    frames = int((keys[-1] - keys[0]) * fps + 1e-3) + 1
    outputs = {sampler["output"] for sampler in animation["samplers"]}
    held = sum(file.held(output) for output in outputs)
    if frames * nodes > SPARSEST * held + MOST_OF_FEW:
        raise file.error(
            f"the animation has {len(keys)} keys in {keys[-1] - keys[0]:.0f} s, too few for a motion"
        )
    return keys[0] + np.arange(frames) / fps, fps


def sampled_worlds(
    file: GltfFile, animation: dict[str, Any], nodes: Sequence[int], times: np.ndarray
) -> np.ndarray:
    """World transforms (T, J, 4, 4) of nodes at times (T,), seconds.

    Raises ValueError naming the file for an animation that is damaged. What broken keys make of transforms,
    which may be no numbers, is left to the caller.
    """
    order = parents_first(moving_nodes(file, nodes), file.above)
    with np.errstate(all="ignore"):
        world = worlds(order, file.above, {node: _local(file, animation, node, times) for node in order})
    return np.stack([np.broadcast_to(world[node], (len(times), 4, 4)) for node in nodes], axis=1)


def _keys(file: GltfFile, sampler: dict[str, Any]) -> np.ndarray:
    """Times (K,) of the keys of a sampler, seconds."""
    keys = file.array(sampler["input"], "SCALAR")[:, 0].astype(np.float64)
    if (np.diff(keys) < 0).any() or not (np.abs(keys) <= LARGEST).all():
        raise file.error("the keys of the animation are not in order of time")
    return keys


def _local(file: GltfFile, animation: dict[str, Any], index: int, times: np.ndarray) -> np.ndarray:
    """Transforms (T, 4, 4) of a node relative to its parent."""
    node = file.entries("nodes")[index]
    if "matrix" in node:
        return np.tile(local_transform(node), (len(times), 1, 1))
    values = {path: np.tile(np.array(node.get(path, rest)), (len(times), 1)) for path, rest in REST.items()}
    for channel in animation["channels"]:
        if channel["target"].get("node") == index and channel["target"]["path"] in REST:
            values[channel["target"]["path"]] = sampled_channel(file, animation, channel, times)
    return compose(**values)


def sampled_channel(
    file: GltfFile, animation: dict[str, Any], channel: dict[str, Any], times: np.ndarray
) -> np.ndarray:
    """Values of a channel of REST at times (T,), seconds: (T, 3) or, unit quaternions, (T, 4).

    Raises ValueError naming the file if it is damaged.
    """
    sampler = animation["samplers"][channel["sampler"]]
    kind = "VEC4" if channel["target"]["path"] == "rotation" else "VEC3"
    keys = _keys(file, sampler)
    values = file.array(sampler["output"], kind).astype(np.float64)
    if not len(keys):
        raise file.error("a sampler of the animation has no keys")
    mode = sampler.get("interpolation", "LINEAR")
    if len(values) != len(keys) * (3 if mode == "CUBICSPLINE" else 1):
        raise file.error(f"a sampler of the animation has {len(keys)} keys but {len(values)} values")
    tangents = None
    if mode == "CUBICSPLINE":
        values = values.reshape(len(keys), 3, -1)
        tangents, values = values[:, [0, 2]], values[:, 1]
    if kind == "VEC4" and not np.linalg.norm(values, axis=1).all():
        raise file.error("a rotation of the animation is 0, 0, 0, 0, expected a unit quaternion")
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
