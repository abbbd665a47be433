"""glTF 2.0 binary: each garment as one morph target per frame, the body as a skinned mesh, one animation.

A frame is held exactly: at its time its own target has weight one and all others zero; in between, vertices
move linearly. glTF knows one texture coordinate per vertex, so vertices on texture seams are repeated after
the garment's own vertices, and the mesh's `extras.source_vertices` names the original of each.
"""

import json
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.export.animation import Animation, local_pose, strongest
from uvcloth.mesh import Mesh, vertex_normals
from uvcloth.render import BODY_COLOR, GARMENT_COLORS, Color

INFLUENCES = 4
"""Joint influences per vertex that every glTF reader supports."""

LARGEST = 2**32 - 1
SHORT, INT, FLOAT = 5123, 5125, 5126
TYPES = {FLOAT: np.float32, INT: np.uint32, SHORT: np.uint16}
VERTICES, INDICES = 34962, 34963
# Z up, facing -Y -> Y up, facing +Z.
TO_Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], np.float32)


def write_glb(animation: Animation, path: Path) -> None:
    """Write an animation as one .glb: metres, Y up, seconds.

    Raises InputError if the file would exceed the 4 GiB that the format can hold.
    """
    document = _Document()
    times = np.arange(len(animation), dtype=np.float32) / np.float32(animation.fps)
    time = document.array(times, "SCALAR", bounds=True)
    for index in range(len(animation.names)):
        _add_garment(document, animation, index, time)
    if animation.body is not None:
        _add_body(document, animation, animation.body, time)
    document.write(path)


@dataclass
class _Document:
    """The JSON part as it grows, and what will fill the binary part: functions that yield its bytes."""

    accessors: list[dict[str, Any]] = field(default_factory=list)
    views: list[dict[str, Any]] = field(default_factory=list)
    parts: list[Callable[[], Iterator[np.ndarray]]] = field(default_factory=list)
    length: int = 0
    nodes: list[dict[str, Any]] = field(default_factory=list)
    roots: list[int] = field(default_factory=list)
    meshes: list[dict[str, Any]] = field(default_factory=list)
    materials: list[dict[str, Any]] = field(default_factory=list)
    skins: list[dict[str, Any]] = field(default_factory=list)
    samplers: list[dict[str, Any]] = field(default_factory=list)
    channels: list[dict[str, Any]] = field(default_factory=list)

    def view(
        self,
        length: int,
        part: Callable[[], Iterator[np.ndarray]],
        target: int | None = None,
        stride: int | None = None,
    ) -> int:
        """Reserve `length` bytes (a multiple of 4), which `part` will yield when the file is written.

        stride: needed where several accessors of vertices share the view.
        """
        optional = {"target": target, "byteStride": stride}
        self.views.append(
            {"buffer": 0, "byteOffset": self.length, "byteLength": length}
            | {key: value for key, value in optional.items() if value is not None}
        )
        self.parts.append(part)
        self.length += length
        return len(self.views) - 1

    def array(
        self,
        values: np.ndarray,
        kind: str,
        component: int = FLOAT,
        target: int | None = None,
        bounds: bool = False,
    ) -> int:
        """An accessor over an array of its own. Returns its index."""
        data = np.ascontiguousarray(values, TYPES[component])
        view = self.view(data.nbytes, lambda: iter([data]), target)
        accessor = {"bufferView": view, "componentType": component, "count": len(data), "type": kind}
        if bounds:
            rows = data.reshape(len(data), -1)
            accessor |= {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def animate(self, node: int, path: str, time: int, output: int) -> None:
        self.samplers.append({"input": time, "output": output, "interpolation": "LINEAR"})
        self.channels.append({"sampler": len(self.samplers) - 1, "target": {"node": node, "path": path}})

    def material(self, name: str, color: Color) -> int:
        linear = [channel**2.2 for channel in color]
        self.materials.append(
            {
                "name": name,
                "doubleSided": True,
                "pbrMetallicRoughness": {
                    "baseColorFactor": [*linear, 1.0],
                    "metallicFactor": 0.0,
                    "roughnessFactor": 0.9,
                },
            }
        )
        return len(self.materials) - 1

    def write(self, path: Path) -> None:
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "uvcloth"},
            "scene": 0,
            "scenes": [{"nodes": self.roots}],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": self.length}],
            "animations": [{"name": path.stem, "samplers": self.samplers, "channels": self.channels}],
        }
        if self.skins:
            document["skins"] = self.skins
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + self.length
        if total > LARGEST:
            raise InputError(
                f"{path.name}: {total / 2**30:.1f} GiB do not fit into a .glb (at most 4 GiB), "
                "write fewer frames or another format"
            )
        with path.open("wb") as stream:
            stream.write(struct.pack("<4sII", b"glTF", 2, total))
            stream.write(struct.pack("<I4s", len(text), b"JSON") + text)
            stream.write(struct.pack("<I4s", self.length, b"BIN\0"))
            for part in self.parts:
                for data in part():
                    stream.write(np.ascontiguousarray(data).data)


def _add_garment(document: _Document, animation: Animation, index: int, time: int) -> None:
    name, mesh, vertices = animation.names[index], animation.meshes[index], animation.vertices[index]
    source, primitive = _add_mesh(document, mesh)
    primitive["material"] = document.material(name, GARMENT_COLORS[index % len(GARMENT_COLORS)])
    base, base_normals = mesh.vertices.numpy(), _normals(mesh.vertices.numpy(), mesh)

    def deltas() -> Iterator[np.ndarray]:
        for frames in animation.chunks():
            yield (vertices[frames] - base)[:, source] @ TO_Y_UP.T

    def normal_deltas() -> Iterator[np.ndarray]:
        for frames in animation.chunks():
            turned = _normals(np.array(vertices[frames]), mesh) - base_normals
            yield turned[:, source] @ TO_Y_UP.T

    size = len(source) * 12
    positions = document.view(len(animation) * size, deltas, VERTICES, stride=12)
    normals = document.view(len(animation) * size, normal_deltas, VERTICES, stride=12)
    low = np.concatenate([chunk.min(1) for chunk in deltas()]).tolist()
    high = np.concatenate([chunk.max(1) for chunk in deltas()]).tolist()
    shared = {"componentType": FLOAT, "count": len(source), "type": "VEC3"}
    primitive["targets"] = []
    for frame in range(len(animation)):
        at = {**shared, "byteOffset": frame * size}
        document.accessors.append({**at, "bufferView": positions, "min": low[frame], "max": high[frame]})
        document.accessors.append({**at, "bufferView": normals})
        last = len(document.accessors) - 1
        primitive["targets"].append({"POSITION": last - 1, "NORMAL": last})

    def weights() -> Iterator[np.ndarray]:
        for frames in animation.chunks():
            yield np.eye(frames.stop - frames.start, len(animation), frames.start, dtype=np.float32)

    document.accessors.append(
        {
            "bufferView": document.view(4 * len(animation) ** 2, weights),
            "componentType": FLOAT,
            "count": len(animation) ** 2,
            "type": "SCALAR",
        }
    )
    output = len(document.accessors) - 1
    document.meshes.append(
        {
            "name": name,
            "primitives": [primitive],
            "weights": [0.0] * len(animation),
            "extras": {"source_vertices": source.tolist()},
        }
    )
    document.nodes.append({"name": name, "mesh": len(document.meshes) - 1})
    document.roots.append(len(document.nodes) - 1)
    document.animate(len(document.nodes) - 1, "weights", time, output)


def _add_body(document: _Document, animation: Animation, body: Body, time: int) -> None:
    source, primitive = _add_mesh(document, body.mesh)
    joints, weights = strongest(body.weights, INFLUENCES)
    primitive["attributes"]["JOINTS_0"] = document.array(joints[source], "VEC4", SHORT, VERTICES)
    primitive["attributes"]["WEIGHTS_0"] = document.array(weights[source], "VEC4", FLOAT, VERTICES)
    primitive["material"] = document.material("body", BODY_COLOR)
    document.meshes.append(
        {"name": "body", "primitives": [primitive], "extras": {"source_vertices": source.tolist()}}
    )

    skeleton = body.skeleton
    heads = skeleton.heads.numpy() @ TO_Y_UP.T
    first = len(document.nodes) + 1
    inverse_bind = np.tile(np.eye(4, dtype=np.float32), (len(heads), 1, 1))
    inverse_bind[:, 3, :3] = -heads  # Column-major: the last four numbers are the shift.
    document.skins.append(
        {
            "inverseBindMatrices": document.array(inverse_bind.reshape(-1, 16), "MAT4"),
            "joints": list(range(first, first + len(heads))),
        }
    )
    document.roots.append(len(document.nodes))
    document.nodes.append({"name": "body", "mesh": len(document.meshes) - 1, "skin": 0})
    translations, rotations = local_pose(skeleton, animation.transforms)
    for joint, parent in enumerate(skeleton.parents):
        bone = heads[joint] - heads[parent] if parent >= 0 else heads[joint]
        node: dict[str, Any] = {"name": skeleton.names[joint], "translation": bone.tolist()}
        children = [first + child for child, of in enumerate(skeleton.parents) if of == joint]
        document.nodes.append(node | ({"children": children} if children else {}))
        if parent < 0:
            document.roots.append(first + joint)
        quaternions = rotations[:, joint]
        turned = np.concatenate([quaternions[:, :3] @ TO_Y_UP.T, quaternions[:, 3:]], axis=1)
        document.animate(first + joint, "rotation", time, document.array(turned, "VEC4"))
        shifts = translations[:, joint] @ TO_Y_UP.T
        if np.abs(shifts - bone).max() > 1e-6:
            document.animate(first + joint, "translation", time, document.array(shifts, "VEC3"))


def _add_mesh(document: _Document, mesh: Mesh) -> tuple[np.ndarray, dict[str, Any]]:
    """Its rest geometry: the source vertex of each glTF vertex (M,), and a primitive without material."""
    source, faces, uvs = split_seams(mesh)
    positions = mesh.vertices.numpy()[source] @ TO_Y_UP.T
    normals = _normals(mesh.vertices.numpy(), mesh)[source] @ TO_Y_UP.T
    attributes = {
        "POSITION": document.array(positions, "VEC3", FLOAT, VERTICES, bounds=True),
        "NORMAL": document.array(normals, "VEC3", FLOAT, VERTICES),
    }
    if len(mesh.uvs):
        # glTF measures the second coordinate from the top of the picture.
        attributes["TEXCOORD_0"] = document.array(uvs * [1, -1] + [0, 1], "VEC2", FLOAT, VERTICES)
    indices = document.array(faces.ravel(), "SCALAR", INT, INDICES)
    return source, {"attributes": attributes, "indices": indices}


def split_seams(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One texture coordinate per vertex: source vertices (M,), faces (F, 3), uvs (M, 2).

    The first V vertices are the mesh's own in their order; the repeated ones of seams follow.
    """
    count = len(mesh.vertices)
    vertex, faces = mesh.faces.numpy().ravel(), mesh.faces.numpy()
    if not len(mesh.uvs):
        return np.arange(count), faces, np.zeros((count, 2), np.float32)
    pairs, corner = np.unique(
        np.stack([vertex, mesh.face_uvs.numpy().ravel()], axis=1), axis=0, return_inverse=True
    )
    owner, uv = pairs[:, 0], pairs[:, 1]
    first = np.r_[True, owner[1:] != owner[:-1]]
    place = np.where(first, owner, count + np.cumsum(~first) - 1)
    source = np.concatenate([np.arange(count), owner[~first]])
    uvs = np.zeros((len(source), 2), np.float32)
    uvs[place] = mesh.uvs.numpy()[uv]
    return source, place[corner.ravel()].reshape(-1, 3), uvs


def _normals(vertices: np.ndarray, mesh: Mesh) -> np.ndarray:
    """Unit normals (..., V, 3); a vertex without faces points up."""
    normals = vertex_normals(torch.from_numpy(vertices), mesh.faces).numpy()
    normals[np.linalg.norm(normals, axis=-1) < 0.5] = (0.0, 0.0, 1.0)
    return normals
