"""A character's own joints: those that a body of it moves with, as the nodes of its file."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from torch import Tensor, tensor

from uvcloth.characters.rig import RiggedCharacter
from uvcloth.formats.gltf import read_gltf
from uvcloth.formats.gltf_rig import largest_skin, read_rig
from uvcloth.geometry.skeleton import Skeleton


@dataclass(frozen=True)
class OwnJoints:
    """U joints of a character that move its body, which has J joints, from the body's rest pose.

    skeleton: their names in the file, metres, Z up, in the rest pose of our bodies. nodes: U, of the file.
    ours: U of our joints that they stand for. names: U, of ours. mover: (J,) the joint among them that moves
    each of the body's. axes: (4, 4) from the file's scene to metres, Z up. inverse_bind: (U, 4, 4) from the
    rest pose, in the axes and the unit of the scene, to the node.
    """

    skeleton: Skeleton
    nodes: tuple[int, ...]
    ours: tuple[int, ...]
    names: tuple[str, ...]
    mover: Tensor
    axes: np.ndarray
    inverse_bind: np.ndarray


def own_joints(path: Path, rigged: RiggedCharacter) -> OwnJoints:
    """The joints of a character that was read from a file and put on our skeleton.

    Raises InputError as `read_gltf` does.
    """
    file = read_gltf(path)
    rig = read_rig(file, largest_skin(file))
    first: dict[int, int] = {}
    for ours, joint in enumerate(rigged.movers):
        first.setdefault(joint, ours)
    place = {joint: index for index, joint in enumerate(first)}
    mover = [place[joint] for joint in rigged.movers]
    axes = np.eye(4)
    axes[:3, :3] = rigged.axes.double().numpy()
    inverse_bind = []
    for joint, ours in first.items():
        rested = np.eye(4)
        rested[:3] = rigged.rested[ours].double().numpy()
        to_rest = np.linalg.inv(axes) @ rested @ axes
        inverse_bind.append(np.linalg.inv(to_rest @ rig.bind[joint]))
    return OwnJoints(
        Skeleton(
            tuple(rig.names[joint] for joint in first),
            _parents(rigged.skeleton, first, mover),
            rigged.skeleton.heads[list(first.values())],
        ),
        tuple(rig.nodes[joint] for joint in first),
        tuple(first.values()),
        tuple(rigged.skeleton.names[ours] for ours in first.values()),
        tensor(mover),
        axes,
        np.stack(inverse_bind),
    )


def _parents(skeleton: Skeleton, first: Mapping[int, int], mover: list[int]) -> tuple[int, ...]:
    """Parent of each joint: the one that moves the nearest of our joints above that it does not move."""
    parents = []
    for place, ours in enumerate(first.values()):
        above = skeleton.parents[ours]
        while above >= 0 and mover[above] == place:
            above = skeleton.parents[above]
        parents.append(mover[above] if above >= 0 else -1)
    return tuple(parents)
