"""glTF 2.0 binary: each garment as one morph target per frame, the body as a skinned mesh, one animation.

A frame is held exactly: at its time its own target has weight one and all others zero; in between, vertices
move linearly.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from uvcloth.rendering.render import GARMENT_COLORS
from uvcloth.writers.animation import Animation
from uvcloth.writers.glb import Document
from uvcloth.writers.gltf_body import add_body
from uvcloth.writers.gltf_scene import (
    TO_Y_UP,
    add_skeleton,
    animate_skeleton,
    unit_normals,
)
from uvcloth.writers.gltf_surface import add_surface
from uvcloth.writers.gltf_targets import add_frames, target_names


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

    output = add_frames(document, primitives, len(animation), len(source), deltas, normal_deltas)
    extras = {"source_vertices": source.tolist(), "targetNames": target_names(len(animation))}
    node = document.mesh(name, primitives, weights=[0.0] * len(animation), extras=extras)
    document.animate(node, "weights", time, output)
