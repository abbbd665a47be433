"""A glTF file of a box on two joints that wave, written by the tests, independent of the reader."""

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from tests.small_body import small_body

WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
KINDS = {"f": 5126, "u1": 5121, "u2": 5123}
INDEX_KINDS = {"u1": 5121, "u2": 5123, "u4": 5125}

PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)
"""A picture of one pixel, PNG."""


def document() -> tuple[dict[str, Any], bytes]:
    """JSON, whose buffer has no URI yet, and buffer: a textured and coloured skin, and an animation of it."""
    body = small_body()
    vertices, heads = body.mesh.vertices.numpy(), body.skeleton.heads.numpy()
    accessors: list[dict[str, Any]] = []
    views: list[dict[str, Any]] = []
    content = b""

    def add(values: np.ndarray) -> int:
        nonlocal content
        values = np.ascontiguousarray(values)
        kind = "f" if values.dtype.kind == "f" else values.dtype.str[1:]
        views.append({"buffer": 0, "byteOffset": len(content), "byteLength": values.nbytes})
        content += values.tobytes() + bytes(-values.nbytes % 4)
        width = WIDTHS[values.shape[1]]
        entry = {"bufferView": len(views) - 1, "componentType": KINDS[kind], "count": len(values)}
        accessors.append(entry | {"type": width})
        return len(accessors) - 1

    inverse = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
    inverse[:, 3, :3] = -heads  # Columns one after another.
    weights = np.zeros((8, 4), np.float32)
    weights[:, :2] = body.weights.numpy()
    attributes = {
        "POSITION": add(vertices),
        "TEXCOORD_0": add(body.mesh.uvs.numpy()),
        "COLOR_0": add(np.full((8, 4), 0.5, np.float32)),
        "JOINTS_0": add(np.tile(np.array([0, 1, 0, 0], np.uint8), (8, 1))),
        "WEIGHTS_0": add(weights),
    }
    times = add(np.array([[0.0], [0.5], [1.0]], np.float32))
    turns = np.array([[0, 0, 0, 1], [0, 0.6, 0, 0.8], [0, 0, 0, 1]], np.float32)
    shifts = np.zeros((9, 3), np.float32)
    shifts[4] = (0.0, 0.0, 0.1)
    samplers = [
        {"input": times, "output": add(turns)},
        {"input": times, "output": add(shifts), "interpolation": "CUBICSPLINE"},
        {"input": times, "output": add(np.ones((3, 3), np.float32)), "interpolation": "STEP"},
    ]
    indices = add(body.mesh.faces.numpy().astype(np.uint16).reshape(-1, 1))
    bind = add(inverse.reshape(2, 16))
    picture = {"buffer": 0, "byteOffset": len(content), "byteLength": len(PIXEL)}
    content += PIXEL + bytes(-len(PIXEL) % 4)
    paths = ((1, "rotation"), (0, "translation"), (1, "scale"))
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 2]}],
        "nodes": [
            {"name": "hips", "translation": heads[0].tolist(), "children": [1]},
            {"name": "chest", "translation": (heads[1] - heads[0]).tolist()},
            {"name": "box", "mesh": 0, "skin": 0},
        ],
        "meshes": [
            {"name": "box", "primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}
        ],
        "skins": [{"joints": [0, 1], "inverseBindMatrices": bind, "skeleton": 0}],
        "animations": [
            {
                "samplers": samplers,
                "channels": [
                    {"sampler": sampler, "target": {"node": node, "path": path}}
                    for sampler, (node, path) in enumerate(paths)
                ],
            }
        ],
        "materials": [
            {
                "name": "wool",
                "pbrMetallicRoughness": {
                    "baseColorFactor": [0.8, 0.2, 0.2, 1.0],
                    "baseColorTexture": {"index": 0, "texCoord": 0},
                },
            }
        ],
        "textures": [{"source": 0}],
        "images": [{"name": "wool", "mimeType": "image/png", "bufferView": len(views)}],
        "accessors": accessors,
        "bufferViews": [*views, picture],
        "buffers": [{"byteLength": len(content)}],
    }, content


def sparse_document(zeros: bool) -> tuple[dict[str, Any], bytes]:
    """The same, every accessor sparse: on zeros without a buffer view, or on a view with wrong values."""
    written, content = document()
    numbers = {code: np.dtype(kind) for kind, code in KINDS.items()}
    widths = {name: width for width, name in WIDTHS.items()}

    def add(values: np.ndarray) -> int:
        nonlocal content
        written["bufferViews"].append({"buffer": 0, "byteOffset": len(content), "byteLength": values.nbytes})
        content += values.tobytes() + bytes(-values.nbytes % 4)
        return len(written["bufferViews"]) - 1

    for number, entry in enumerate(written["accessors"]):
        start = written["bufferViews"][entry["bufferView"]]["byteOffset"]
        kind, width = numbers[entry["componentType"]], widths[entry["type"]]
        values = np.frombuffer(content, kind, entry["count"] * width, start).reshape(-1, width)
        replaced = np.flatnonzero(values.any(axis=1)) if zeros else np.arange(0, len(values), 2)
        if zeros:
            del entry["bufferView"]
        else:
            wrong = values.copy()
            wrong[replaced] += 1
            content = content[:start] + wrong.tobytes() + content[start + wrong.nbytes :]
        index = np.dtype(("u1", "u2", "u4")[number % 3])
        entry["sparse"] = {
            "count": len(replaced),
            "indices": {
                "bufferView": add(replaced.astype(index)),
                "componentType": INDEX_KINDS[index.str[1:]],
            },
            "values": {"bufferView": add(values[replaced])},
        }
    written["buffers"][0]["byteLength"] = len(content)
    return written, content


def write_glb(path: Path, written: dict[str, Any], content: bytes) -> Path:
    """Write a .glb as it is given, right or wrong."""
    text = json.dumps(written).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(content), 0x004E4942) + content
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
    return path


def write_gltf(path: Path, written: dict[str, Any], content: bytes) -> Path:
    """Write a .gltf with its buffer, and a copy of its picture as a file, beside it."""
    path.with_suffix(".bin").write_bytes(content)
    path.with_suffix(".png").write_bytes(PIXEL)
    written["buffers"][0]["uri"] = path.with_suffix(".bin").name
    written["images"] = [{"uri": path.with_suffix(".png").name}]
    path.write_text(json.dumps(written))
    return path
