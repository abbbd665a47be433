"""Bones of an armature as the joints of a baked file: NumPy alone, no Blender."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

TO_Z_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""Turn from the axes of glTF, Y up, to those of Blender."""

UNEVEN = 1e-3
"""Largest difference of an armature's axes, made unit, from a rotation."""

SCALED = 0.02
"""Difference of a bone's squared lengths and its angles from a rotation's from which on it is scaled."""

APART = 1e-3
"""Largest difference between bones and joints at which they are taken for the same, in parts of a metre."""


@dataclass(frozen=True)
class Rig:
    """Bones that take the place of J joints.

    bones: their names. to_nodes: (J, 4, 4) from the axes of the nodes of the file to those of the bones,
    constant. size: scale of the armature for which that holds.
    """

    bones: tuple[str, ...]
    to_nodes: Floats
    size: float

    def worlds(self, armature: Floats, poses: Floats) -> tuple[Floats, float]:
        """Transforms (J, 4, 4) of the nodes to the scene of the file, and how often the armature is its size.

        armature: (4, 4) to the world. poses: (J, 4, 4) of the bones to the armature. Cloth is solved at the
        size that it was baked for. Raises ValueError for a scale that no cloth is solved at.
        """
        scale = even_scale(armature) / self.size
        grams = np.swapaxes(poses[:, :3, :3], 1, 2) @ poses[:, :3, :3]
        scaled = np.abs(grams - np.eye(3)).max((1, 2)) > SCALED
        if scaled.any():
            raise ValueError(
                f"bone {self.bones[int(scaled.argmax())]} is scaled or stretched: cloth follows bones "
                "that turn and move"
            )
        worlds = np.linalg.inv(TO_Z_UP) @ armature @ poses @ self.to_nodes
        worlds[:, :3] /= scale
        return worlds, scale


def even_scale(armature: Floats) -> float:
    """Scale of a transform (4, 4). Raises ValueError for one that is negative, or uneven."""
    linear = armature[:3, :3]
    size = float(np.cbrt(np.linalg.det(linear)))
    if size <= 0.0:
        raise ValueError("the armature has a negative scale, or none: cloth needs a positive one")
    if np.abs(linear @ linear.T / size**2 - np.eye(3)).max() > UNEVEN:
        raise ValueError("the armature has an uneven scale: cloth needs the same along X, Y and Z")
    return size


def match_bones(names: Sequence[str], armature: Floats, poses: Floats, candidates: Sequence[Floats]) -> Rig:
    """The rig of bones in a pose that is that of one of the candidates, each (J, 4, 4) transforms of nodes.

    armature, poses: as of Rig.worlds. All bones are turned against their nodes in the same way, and begin
    where those do, in the right candidate alone. Raises ValueError if there is none.
    """
    size = even_scale(armature)
    back = np.linalg.inv(np.linalg.inv(TO_Z_UP) @ armature @ poses)
    best = min((back @ worlds for worlds in candidates), key=_spread)
    if _spread(best) > APART:
        raise ValueError("the bones of the armature are not where the joints of its cloth are")
    return Rig(tuple(names), best, size)


def _spread(to_nodes: Floats) -> float:
    """Largest difference between joints in how their bones lie against them."""
    return float(np.abs(to_nodes - np.median(to_nodes, axis=0)).max())
