"""glTF 2.0 binary: each garment as one morph target per frame, the body as a skinned mesh, one animation.

A frame is held exactly: at its time its own target has weight one and all others zero; in between, vertices
move linearly.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from uvcloth.export.animation import Animation
from uvcloth.export.glb import FLOAT, VERTICES, Document
from uvcloth.export.gltf_body import add_body
from uvcloth.export.gltf_scene import (
    TO_Y_UP,
    add_skeleton,
    animate_skeleton,
    unit_normals,
)
from uvcloth.export.gltf_surface import add_surface
from uvcloth.render import GARMENT_COLORS


def write_glb(animation: Animation, path: Path) -> None:
    """Write an animation as one .glb: metres, Y up, seconds.

    Raises InputError if the file would exceed the 4 GiB that the format can hold.
    """
    document = Document()
    times = np.arange(len(animation), dtype=np.float32) / np.float32(animation.fps)
    time = document.array(times, "SCALAR", bounds=True)
    for index in range(len(animation.names)):
        _add_garment(document, animation, index, time)
    if animation.body is not None:
        skin, first = add_skeleton(document, animation.body.skeleton)
        add_body(document, animation.body, skin)
        animate_skeleton(document, animation.body.skeleton, first, animation.transforms, time)
    document.write(path)


def _add_garment(document: Document, animation: Animation, index: int, time: int) -> None:
    name, mesh, vertices = animation.names[index], animation.meshes[index], animation.vertices[index]
    source, primitives = add_surface(document, name, mesh, GARMENT_COLORS[index % len(GARMENT_COLORS)])
    base, base_normals = mesh.vertices.numpy(), unit_normals(mesh.vertices.numpy(), mesh)

    def deltas() -> Iterator[np.ndarray]:
        for frames in animation.chunks():
            yield (vertices[frames] - base)[:, source] @ TO_Y_UP.T

    def normal_deltas() -> Iterator[np.ndarray]:
        for frames in animation.chunks():
            turned = unit_normals(np.array(vertices[frames]), mesh) - base_normals
            yield turned[:, source] @ TO_Y_UP.T

    size = len(source) * 12
    positions = document.view(len(animation) * size, deltas, VERTICES, stride=12)
    normals = document.view(len(animation) * size, normal_deltas, VERTICES, stride=12)
    low = np.concatenate([chunk.min(1) for chunk in deltas()]).tolist()
    high = np.concatenate([chunk.max(1) for chunk in deltas()]).tolist()
    shared = {"componentType": FLOAT, "count": len(source), "type": "VEC3"}
    targets = []
    for frame in range(len(animation)):
        at = {**shared, "byteOffset": frame * size}
        document.accessors.append({**at, "bufferView": positions, "min": low[frame], "max": high[frame]})
        document.accessors.append({**at, "bufferView": normals})
        last = len(document.accessors) - 1
        targets.append({"POSITION": last - 1, "NORMAL": last})

    for primitive in primitives:
        primitive["targets"] = targets

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
    # Blender and others take the names of shape keys from here.
    names = [f"frame_{frame:05d}" for frame in range(len(animation))]
    extras = {"source_vertices": source.tolist(), "targetNames": names}
    node = document.mesh(name, primitives, weights=[0.0] * len(animation), extras=extras)
    document.animate(node, "weights", time, output)
