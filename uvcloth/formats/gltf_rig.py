"""Skeletons in glTF files: the tree of nodes, and the bind pose of a skin in the scene."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from uvcloth.errors import InputError
from uvcloth.formats.gltf import Gltf
from uvcloth.formats.vrm import human_bones
from uvcloth.geometry.skeleton import check_joints
from uvcloth.player.gltf_document import LARGEST
from uvcloth.player.gltf_file import one_line
from uvcloth.player.nodes import chain, local_transform, parents_first, worlds

FLAT = 1e-6
"""Relative volume of the transformed unit cube below which a transform counts as flat."""

AFFINE = 1e-3
"""Largest difference of the last row of a transform from 0, 0, 0, 1."""


@dataclass(frozen=True)
class SkinJoints:
    """Joints of a skin, parents before children.

    names: J, each once. parents: J indices, -1 for a root. nodes: the file's index of each joint. bind:
    (J, 4, 4) joints to the world in the bind pose, in which the mesh was modelled. placing: (4, 4) from the
    mesh's own axes, units and origin to the scene's, in which the first joint is where it rests. bones: J
    human bones of a VRM file, "" for other joints.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    nodes: list[int]
    bind: np.ndarray
    placing: np.ndarray
    bones: tuple[str, ...]


def largest_skin(file: Gltf) -> dict[str, Any]:
    """The skin of a file that has most joints, the first of several. Raises InputError if it has none."""
    skin = max(file.entries("skins"), key=lambda entry: len(entry["joints"]), default=None)
    if skin is None:
        raise file.error("has no skin: its meshes are not bound to a skeleton, rig it first")
    return skin


def read_rig(file: Gltf, skin: dict[str, Any]) -> SkinJoints:
    """Read the joints of a skin and their bind pose; human bones of a VRM file that it lacks are joints too.

    Raises InputError naming the file for too many joints, and for a joint whose bind pose is flat.
    """
    above, bones = file.above, human_bones(file)
    members = list(dict.fromkeys((*skin["joints"], *bones)))
    names = [one_line(file.entries("nodes")[node].get("name", f"node {node}")) for node in members]
    check_joints(file.path, names)
    joints = parents_first(members, above)
    number = {node: index for index, node in enumerate(joints)}
    parents = [
        next((number[other] for other in chain(node, above) if other in number), -1) for node in joints
    ]
    place = {node: index for index, node in enumerate(members)}
    unique = _distinct_names([names[place[node]] for node in joints])
    human = tuple(bones.get(node, "") for node in joints)
    resting = resting_worlds(file, joints)
    rest = np.stack([resting[node] for node in joints])
    if "inverseBindMatrices" not in skin:
        _require_solid(file, unique, rest)
        return SkinJoints(unique, tuple(parents), joints, rest, np.eye(4), human)
    skinned = [index for index, node in enumerate(joints) if place[node] < len(skin["joints"])]
    inverse = inverse_bind(file, skin)[[place[joints[index]] for index in skinned]]
    _require_solid(file, [unique[index] for index in skinned], inverse)
    poses = np.linalg.inv(inverse)
    first = skinned[0]
    _require_solid(file, unique[first : first + 1], rest[first][None])
    # The mesh may be modelled in other axes and units than the scene's: those of the root joint tell.
    placing = rest[first] @ np.linalg.inv(poses[0])
    size = np.linalg.norm(placing[:3, :3], axis=0) * np.sign(np.linalg.det(placing[:3, :3]))
    axes = np.eye(4)
    axes[:3, :3] = _nearest_axes(placing[:3, :3] / size) * size
    bind = np.zeros_like(rest)
    bind[skinned] = axes @ poses
    for index in sorted(set(range(len(joints))) - set(skinned)):
        # A joint that moves no vertex has no bind pose: it keeps its place at rest on its nearest ancestor.
        beside = next((number[node] for node in chain(joints[index], above) if node in number), first)
        _require_solid(file, [unique[beside]], rest[[beside]])
        bind[index] = bind[beside] @ np.linalg.inv(rest[beside]) @ rest[index]
    _require_solid(file, unique, bind)
    placing = axes.copy()
    placing[:3, 3] = rest[first][:3, 3] - bind[first][:3, 3]
    return SkinJoints(unique, tuple(parents), joints, bind, placing, human)


def _distinct_names(names: Sequence[str]) -> tuple[str, ...]:
    """The names, with their index where two are equal."""
    counts = Counter(names)
    numbered = [f"{name} {i}" if counts[name] > 1 else name for i, name in enumerate(names)]
    return tuple(numbered) if len(set(numbered)) == len(names) else _distinct_names(numbered)


def inverse_bind(file: Gltf, skin: dict[str, Any]) -> np.ndarray:
    """Inverse bind matrices (J, 4, 4) of a skin, in the order of its joints.

    Raises InputError naming the file if there are fewer than joints.
    """
    values = file.array(skin["inverseBindMatrices"], "MAT4").reshape(-1, 4, 4)
    if len(values) < len(skin["joints"]):
        raise InputError(
            f"{file.path}: a skin has {len(values)} inverse bind matrices for {len(skin['joints'])} joints"
        )
    return np.asarray(values.swapaxes(1, 2), dtype=np.float64)


def _require_solid(file: Gltf, names: Sequence[str], transforms: np.ndarray) -> None:
    """Raise InputError naming the first joint whose transform (J, 4, 4) is flat, huge, or not affine."""
    linear = transforms[:, :3, :3]
    size = np.linalg.norm(linear, axis=(1, 2))
    solid = np.abs(np.linalg.det(linear / np.where(size > 0, size, 1.0)[:, None, None])) > FLAT
    solid &= np.abs(transforms[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) < AFFINE
    solid &= np.abs(transforms).max(axis=(1, 2)) <= LARGEST
    broken = np.flatnonzero(~solid)
    if len(broken):
        raise InputError(
            f"{file.path}: the bind pose of joint {names[broken[0]]} is not a rotation and translation"
        )


def resting_worlds(file: Gltf, nodes: Iterable[int]) -> dict[int, np.ndarray]:
    """World transforms (4, 4) of nodes, and of their ancestors, without the file's animations."""
    above = file.above
    wanted = set(nodes)
    for node in tuple(wanted):
        wanted |= set(chain(node, above))
    order = parents_first(wanted, above)
    return worlds(order, above, {node: local_transform(file.entries("nodes")[node]) for node in order})


def _nearest_axes(rotation: np.ndarray) -> np.ndarray:
    """Rotation by right angles that is nearest to a rotation (3, 3), or that itself where none is near."""
    order = np.abs(rotation).argmax(0)
    axes = np.zeros((3, 3))
    axes[order, range(3)] = np.sign(rotation[order, range(3)])
    return axes if np.linalg.det(axes) > 0.5 else rotation
