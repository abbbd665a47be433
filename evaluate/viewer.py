"""Mesh animations packed small enough to live inside an HTML page.

Positions are quantized to half a millimetre. The first mesh of a clip is stored as second
differences in time, the others as second differences of their offsets from the first. 16-bit
values are split into planes of low and high bytes, compressed with gzip and written as base64.
`templates/viewer.js` holds the inverse.
"""

import base64
import gzip
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from torch import Tensor

from uvcloth.bodies.body import Body

QUANTUM = 0.0005
"""Metres; a coarser step is taken where a clip travels farther than 32 m."""

INFLUENCES = 4


@dataclass(frozen=True)
class ViewerClip:
    """One window to scrub through: the same garment from the simulation and from the methods.

    meshes: by name, the simulation first, each (F, N, 3) metres, world. faces: (M, 3). body: drawn under the
    garment. transforms: (F, J, 3, 4) of its joints. stride: scored frames from
    one that is shown to the next, the first one being shown. fps: shown frames per second.
    """

    action: str
    garment: str
    fps: float
    stride: int
    faces: Tensor
    body: Body
    transforms: Tensor
    meshes: Mapping[str, Tensor]


def pack_clip(clip: ViewerClip, methods: Sequence[str], body: int) -> tuple[dict[str, Any], str]:
    """A JSON header and the base64 text of one clip.

    methods: all methods of the page, in the order of their colours. body: index of the clip's body on it.
    """
    positions = [mesh.numpy() for mesh in clip.meshes.values()]
    low = np.min([mesh.min((0, 1)) for mesh in positions], axis=0)
    extent = np.max([mesh.max((0, 1)) for mesh in positions], axis=0) - low
    quantum = max(QUANTUM, float(extent.max()) / 65000)
    quantized = [np.rint((mesh - low) / quantum).astype(np.uint16) for mesh in positions]
    planes = [_planes(_second_differences(quantized[0]))]
    planes += [_planes(_second_differences(mesh - quantized[0])) for mesh in quantized[1:]]
    frames, vertices = positions[0].shape[:2]
    transforms = clip.transforms.numpy().astype("<f4")
    header = {
        "action": clip.action,
        "garment": clip.garment,
        "fps": clip.fps,
        "stride": clip.stride,
        "frames": frames,
        "vertices": vertices,
        "faces": len(clip.faces),
        "body": body,
        "joints": transforms.shape[1],
        "origin": [float(value) for value in low],
        "quantum": quantum,
        "meshes": list(clip.meshes),
        "colors": [methods.index(name) for name in list(clip.meshes)[1:]],
    }
    blob = clip.faces.numpy().astype("<u4").tobytes() + transforms.tobytes() + b"".join(planes)
    return header, _compress(blob)


def pack_body(body: Body) -> tuple[dict[str, Any], str]:
    """A JSON header and the base64 text of a body at rest with its four strongest influences per vertex."""
    strongest = body.weights.topk(min(INFLUENCES, body.weights.shape[1]), dim=1)
    weights = strongest.values / strongest.values.sum(1, keepdim=True)
    header = {
        "vertices": len(body.mesh.vertices),
        "faces": len(body.mesh.faces),
        "influences": strongest.indices.shape[1],
    }
    blob = (
        body.mesh.vertices.numpy().astype("<f4").tobytes()
        + body.mesh.faces.numpy().astype("<u4").tobytes()
        + np.rint(weights.numpy() * 255).astype("u1").tobytes()
        + strongest.indices.numpy().astype("u1").tobytes()
    )
    return header, _compress(blob)


def _second_differences(values: np.ndarray) -> np.ndarray:
    """uint16 (F, N, 3) -> uint16 differences modulo 2^16; the first frame is differenced over vertices."""
    velocity = values.copy()
    velocity[1:] -= values[:-1]
    velocity[0, 1:] -= values[0, :-1]
    change = velocity.copy()
    change[2:] -= velocity[1:-1]
    return change


def _planes(values: np.ndarray) -> bytes:
    """Low bytes, then high bytes of the zigzag code, coordinate by coordinate, so that gzip finds runs."""
    signed = values.astype(np.int16)
    zigzag = ((signed << 1) ^ (signed >> 15)).astype(np.uint16)
    ordered = np.ascontiguousarray(zigzag.transpose(0, 2, 1)).reshape(-1)
    return (ordered & 0xFF).astype("u1").tobytes() + (ordered >> 8).astype("u1").tobytes()


def _compress(blob: bytes) -> str:
    """Compressed bytes as base64 text."""
    return base64.b64encode(gzip.compress(blob, 9, mtime=0)).decode("ascii")
