"""Moving meshes in glTF files: one morph target for each frame, and weights that show one after another."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from uvcloth.writers.glb import FLOAT, VERTICES, Document

Chunks = Callable[[], Iterator[np.ndarray]]

WEIGHTS_AT_ONCE = 256
"""Frames whose weights are in memory at once."""


def add_frames(
    document: Document,
    primitives: list[dict[str, Any]],
    frames: int,
    vertices: int,
    offsets: Chunks,
    normal_offsets: Chunks,
) -> int:
    """Add a target for each frame to the primitives of a mesh of M vertices.

    offsets, normal_offsets: yield those of all frames in order, chunks (B, M, 3); the former are asked for
    three times. Returns the accessor of the weights: at a frame's time its own is one, all others are zero.
    """
    size = vertices * 12
    positions = document.view(frames * size, offsets, VERTICES, stride=12)
    normals = document.view(frames * size, normal_offsets, VERTICES, stride=12)
    low = np.concatenate([chunk.min(1) for chunk in offsets()]).tolist()
    high = np.concatenate([chunk.max(1) for chunk in offsets()]).tolist()
    shared = {"componentType": FLOAT, "count": vertices, "type": "VEC3"}
    targets = []
    for frame in range(frames):
        at = {**shared, "byteOffset": frame * size}
        document.accessors.append({**at, "bufferView": positions, "min": low[frame], "max": high[frame]})
        document.accessors.append({**at, "bufferView": normals})
        last = len(document.accessors) - 1
        targets.append({"POSITION": last - 1, "NORMAL": last})
    for primitive in primitives:
        primitive["targets"] = targets

    def weights() -> Iterator[np.ndarray]:
        for start in range(0, frames, WEIGHTS_AT_ONCE):
            yield np.eye(min(WEIGHTS_AT_ONCE, frames - start), frames, start, dtype=np.float32)

    document.accessors.append(
        {
            "bufferView": document.view(4 * frames**2, weights),
            "componentType": FLOAT,
            "count": frames**2,
            "type": "SCALAR",
        }
    )
    return len(document.accessors) - 1


def target_names(frames: int) -> list[str]:
    """Names of the targets, which Blender and others take for shape keys from a mesh's extras."""
    return [f"frame_{frame:05d}" for frame in range(frames)]
