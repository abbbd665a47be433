"""A rig that follows the pose, for a web page, whose `pose.js` plays it in plain JavaScript."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvcloth.geometry.skinning import strongest
from uvcloth.methods.rig import PoseRig
from uvcloth.writers.page_arrays import pack_arrays

INFLUENCES = 4
"""Joints of a vertex, of which the methods give it no more."""


def pack_pose(rig: PoseRig) -> bytes:
    """Pack a rig: its layers whole, its blend shapes in half precision."""
    joints, weights = strongest(rig.weights[rig.owner], INFLUENCES)
    arrays: dict[str, NDArray[Any]] = {
        "rest": rig.rest.numpy().astype(np.float32),
        "owner": rig.owner.numpy().astype(np.int32),
        "joints": joints.astype(np.uint16),
        "weights": weights.astype(np.float32),
        "shapes": rig.shapes.numpy().astype(np.float16),
        "parents": np.array(rig.parents, np.int32),
    }
    for place, layer in enumerate(rig.layers):
        arrays |= {
            f"{place}.{name}": part.numpy() for name, part in zip(("weight", "bias"), layer, strict=True)
        }
    sizes = [len(mesh.vertices) for _, mesh in rig.garments]
    return pack_arrays(arrays, sizes=sizes, layers=len(rig.layers), sumToOne=rig.sum_to_one)
