"""Motion of joints relative to their parents, as in motion files, and its conversion to a clip."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from uvcloth.geometry.skeleton import Skeleton
from uvcloth.motion.clip import Clip

HELD_JOINTS = 0.6
"""Least share of all joints that a child holds, itself included, to be the person's root instead."""

MOVING = 0.002
"""Least movement of such a child relative to its parent, over the length of all bones."""


@dataclass(frozen=True)
class Hierarchy:
    """Motion of joints relative to their parents, in a file's own units and axes.

    names: J joint names, parents before children. parents: J indices, -1 for the root. offsets: (J, 3) from
    the parent in the rest pose. rotations: (T, J, 3, 3) and positions: (T, J, 3), relative to the parent.
    fps: frames per second.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: np.ndarray
    rotations: np.ndarray
    positions: np.ndarray
    fps: float


def to_clip(name: str, hierarchy: Hierarchy) -> Clip:
    """Make a clip: only the root translates; other joints turn and keep their rest offsets.

    The root is the file's own, or the joint below it that moves instead (a person's hips below the origin of
    a scene); joints that are not below the root are left out.
    """
    world, path = _posed(hierarchy)
    root = _root(hierarchy)
    kept = _below(hierarchy.parents, root)
    heads = np.zeros_like(hierarchy.offsets)
    for joint, parent in enumerate(hierarchy.parents):
        heads[joint] = hierarchy.offsets[joint] + (heads[parent] if parent >= 0 else 0.0)
    number = {joint: index for index, joint in enumerate(kept)}
    return Clip(
        name=name,
        skeleton=Skeleton(
            tuple(hierarchy.names[joint] for joint in kept),
            tuple(number.get(hierarchy.parents[joint], -1) for joint in kept),
            torch.from_numpy(heads[kept].astype(np.float32)),
        ),
        rotations=torch.from_numpy(world[:, kept].astype(np.float32)),
        translation=torch.from_numpy(path[:, root].astype(np.float64)),
        fps=hierarchy.fps,
    )


def _posed(hierarchy: Hierarchy) -> tuple[np.ndarray, np.ndarray]:
    """World rotations (T, J, 3, 3) and positions (T, J, 3)."""
    world, path = hierarchy.rotations.copy(), hierarchy.positions.copy()
    for joint, parent in enumerate(hierarchy.parents):
        if parent >= 0:
            world[:, joint] = world[:, parent] @ hierarchy.rotations[:, joint]
            offset = (world[:, parent] @ hierarchy.positions[:, joint, :, None]).squeeze(-1)
            path[:, joint] = path[:, parent] + offset
    return world, path


def _root(hierarchy: Hierarchy) -> int:
    size = np.linalg.norm(hierarchy.offsets, axis=1).sum()
    root = hierarchy.parents.index(-1)
    while True:
        children = [joint for joint, parent in enumerate(hierarchy.parents) if parent == root]
        moving = (child for child in children if _moves(hierarchy, child, MOVING * size))
        child = next(moving, None)
        if child is None:
            return root
        root = child


def _moves(hierarchy: Hierarchy, joint: int, least: float) -> bool:
    """True for a joint that moves relative to its parent and holds most of the skeleton."""
    way = np.ptp(hierarchy.positions[:, joint], axis=0).max()
    return way > least and len(_below(hierarchy.parents, joint)) >= HELD_JOINTS * len(hierarchy.names)


def _below(parents: Sequence[int], root: int) -> list[int]:
    """Indices of a joint and of all below it, in order."""
    kept = {root}
    for joint, parent in enumerate(parents):
        if parent in kept:
            kept.add(joint)
    return sorted(kept)
