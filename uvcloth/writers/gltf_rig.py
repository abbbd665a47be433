"""glTF 2.0 binary: a rig with skinned garments, blend shapes as morph targets, and its motion if any."""

from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.rendering.render import GARMENT_COLORS
from uvcloth.writers.glb import FLOAT, VERTICES, Document
from uvcloth.writers.gltf_body import add_body
from uvcloth.writers.gltf_scene import (
    TO_Y_UP,
    add_influences,
    add_skeleton,
    animate_skeleton,
)
from uvcloth.writers.gltf_surface import add_surface
from uvcloth.writers.rig import Rig


def write_rig_glb(rig: Rig, path: Path) -> None:
    """Write a rig as one .glb: metres, Y up, seconds. Without playback, the file shows the rest pose.

    Raises InputError if the file would exceed the 4 GiB that the format can hold.
    """
    document = Document()
    skin, first = add_skeleton(document, rig.skeleton)
    nodes = [_add_garment(document, rig, index, skin) for index in range(len(rig.garments))]
    if rig.body is not None:
        add_body(document, rig.body, skin)
    if len(rig.transforms):
        times = np.arange(len(rig.transforms), dtype=np.float32) / np.float32(rig.fps)
        time = document.array(times, "SCALAR", bounds=True)
        animate_skeleton(document, rig.skeleton, first, rig.transforms, time)
        if rig.shape_names:
            weights = document.array(rig.weights.ravel(), "SCALAR")
            for node in nodes:
                document.animate(node, "weights", time, weights)
    document.write(path)


def _add_garment(document: Document, rig: Rig, index: int, skin: int) -> int:
    """Add a garment with all of its targets. Returns its node's index."""
    garment = rig.garments[index]
    color = GARMENT_COLORS[index % len(GARMENT_COLORS)]
    source, primitives = add_surface(document, garment.name, garment.mesh, color)
    influences = add_influences(document, garment.joints[source], garment.weights[source])
    for primitive in primitives:
        primitive["attributes"] |= influences
    extras: dict[str, Any] = {"source_vertices": source.tolist()}
    if not rig.shape_names:
        return document.mesh(garment.name, primitives, skin, extras=extras)
    targets = [
        {
            "POSITION": document.array(shape[source] @ TO_Y_UP.T, "VEC3", FLOAT, VERTICES, bounds=True),
            "NORMAL": document.array(change[source] @ TO_Y_UP.T, "VEC3", FLOAT, VERTICES),
        }
        for shape, change in zip(garment.shapes.numpy(), garment.normal_shapes().numpy(), strict=True)
    ]
    for primitive in primitives:
        primitive["targets"] = targets
    extras["targetNames"] = rig.shape_names
    return document.mesh(garment.name, primitives, skin, weights=rig.resting.tolist(), extras=extras)
