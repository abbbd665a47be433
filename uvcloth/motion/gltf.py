"""Animation of a skeleton in glTF 2.0 files (.glb, .gltf, .vrm, .vrma), with or without a skin."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.errors import InputError
from uvcloth.formats.gltf import SCENES, Gltf, read_gltf
from uvcloth.formats.gltf_rig import SkinJoints, largest_skin, read_rig
from uvcloth.formats.vrm import human_bones
from uvcloth.geometry.roles import table_roles
from uvcloth.motion.clip import Clip
from uvcloth.motion.hierarchy import Hierarchy, to_clip
from uvcloth.player.animation import (
    animation_name,
    animations_of,
    choose_animation,
    frame_times,
    moving_nodes,
    sampled_worlds,
)
from uvcloth.player.gltf_document import LARGEST
from uvcloth.player.nodes import chain

ANIMATED = (*SCENES, ".vrma")
"""Suffixes of the files that `read_gltf_motion` reads."""

SHEAR = 1e-4
"""Largest difference of an entry of a matrix times its transpose from the identity, for a rotation.

Also the least singular value of a sheared matrix that has a nearest rotation.
"""


def read_gltf_motion(path: Path, wanted: str | None = None) -> Clip:
    """Read an animation of the largest skin of a glTF file, as a clip in metres, Y up.

    wanted: name of the animation or its number, from 1, in `animation_names`; None for the first that moves
    anything. The rest pose is the bind pose of the skin, in which its mesh was modelled. A file without a
    skin, an animation for any character, has that of its nodes. Keys are sampled at their own rate, 30 to 120
    per second. Raises InputError naming the file if it has no joints or no such animation, and if the
    animation cannot be read.
    """
    file = read_gltf(path)
    rig = read_rig(file, _moved_skin(file))
    nodes = moving_nodes(file, rig.nodes)
    animation = choose_animation(file, animations_of(file, nodes), wanted)
    times, fps = frame_times(file, animation, len(nodes))
    with np.errstate(all="ignore"):  # Results of broken keys are refused below.
        transforms = sampled_worlds(file, animation, rig.nodes, times)
        clip = to_clip(file.path.stem, _hierarchy(file, rig, transforms, fps))
    bones = dict(zip(rig.names, rig.bones, strict=True))
    return replace(clip, table=table_roles([bones[name] for name in clip.skeleton.names]))


def animation_names(path: Path) -> list[str]:
    """Names of the animations that `read_gltf_motion` chooses from, "" for one without a name.

    Raises InputError naming the file if it is not valid or has no joints.
    """
    file = read_gltf(path)
    nodes = moving_nodes(file, _moved_skin(file)["joints"])
    return [animation_name(animation) for animation in animations_of(file, nodes)]


def _moved_skin(file: Gltf) -> dict[str, Any]:
    """The largest skin of a file; without one, a skin of its human bones or of the nodes that it turns.

    The latter are all nodes below the lowest one that holds every node that an animation turns. Raises
    InputError naming the file if there are none.
    """
    if file.entries("skins"):
        return largest_skin(file)
    joints = list(human_bones(file)) or _turned_tree(file)
    if not joints:
        raise file.error("has no skin, and no animation turns its nodes")
    return {"joints": joints}


def _turned_tree(file: Gltf) -> list[int]:
    turned = {
        channel["target"]["node"]
        for animation in file.entries("animations")
        for channel in animation["channels"]
        if channel["target"]["path"] == "rotation" and "node" in channel["target"]
    }
    ways = [[*reversed(chain(node, file.above)), node] for node in turned]
    shared = [nodes[0] for nodes in zip(*ways, strict=False) if len({*nodes}) == 1]
    return [
        node
        for node in range(len(file.entries("nodes")))
        if node in turned or (shared and shared[-1] in (node, *chain(node, file.above)))
    ]


def _hierarchy(file: Gltf, rig: SkinJoints, transforms: np.ndarray, fps: float) -> Hierarchy:
    """Motion of the joints of a rig relative to their parents, given their world transforms (T, J, 4, 4)."""
    if rig.parents.count(-1) != 1:
        raise InputError(f"{file.path}: the skin has {rig.parents.count(-1)} root joints, expected one")
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
