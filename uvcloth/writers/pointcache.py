"""PC2 point caches with the rest meshes as OBJ, for Blender's Mesh Cache modifier and 3ds Max."""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from uvcloth.writers.animation import Animation, posed_body
from uvcloth.writers.obj import save_obj


def write_pc2(animation: Animation, path: Path) -> None:
    """Write NAME-GARMENT.pc2 and NAME-GARMENT.obj per garment beside path (NAME.pc2), and the body's.

    Metres, Z up, samples one frame apart from frame 0 on; the OBJ keeps the order of vertices and
    texture coordinates.
    """
    for name, mesh, vertices in zip(animation.names, animation.meshes, animation.vertices, strict=True):
        target = path.with_name(f"{path.stem}-{name}{path.suffix}")
        _write_cache(target, len(animation), (vertices[frames] for frames in animation.chunks()))
        save_obj(mesh, target.with_suffix(".obj"))
    if animation.body is not None:
        target = path.with_name(f"{path.stem}-body{path.suffix}")
        _write_cache(target, len(animation), posed_body(animation))
        save_obj(animation.body.mesh, target.with_suffix(".obj"))


def _write_cache(path: Path, frames: int, chunks: Iterator[np.ndarray]) -> None:
    """Write a point cache.

    Header: signature, version 1, points, first frame, frames per sample, samples; then x, y, z floats.
    """
    with path.open("wb") as stream:
        first = next(chunks)
        stream.write(struct.pack("<12siiffi", b"POINTCACHE2\0", 1, first.shape[1], 0.0, 1.0, frames))
        stream.write(np.ascontiguousarray(first, "<f4").data)
        for chunk in chunks:
            stream.write(np.ascontiguousarray(chunk, "<f4").data)
