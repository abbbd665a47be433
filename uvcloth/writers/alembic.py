"""Alembic: garments and body as polygon meshes over time, for DCCs and for engines that train on caches."""

import mmap
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.errors import InputError
from uvcloth.geometry.authored import polygons_of
from uvcloth.geometry.mesh import Mesh
from uvcloth.writers.animation import Animation, posed_body
from uvcloth.writers.gltf_scene import TO_Y_UP

BYTES_PER_POINT, BYTES_PER_FACE = 12, 40

DATE, NO_DATE = b"_ai_DateWritten=", b"Thu Jan  1 00:00:00 1970"
"""Text before the time of writing in the file's metadata, and the time that replaces it."""

RATE = b"_ai_DCC_FPS="
"""Text before the frame rate there, which the library writes in the process's locale: 30,0."""


def write_abc(animation: Animation, path: Path) -> None:
    """Write one .abc: metres, Y up, the first frame at time zero; vertices in the order of the mesh.

    Raises InputError if alembic3d is not installed, and OSError if the disk has no room.
    """
    try:
        from alembic3d import Abc, AbcCoreAbstract
    except ModuleNotFoundError as error:
        raise InputError(f"{path.name}: writing Alembic needs alembic3d: install uvcloth[alembic]") from error
    _reserve(path, animation)
    archive = Abc.CreateArchiveWithInfo(str(path), float(animation.fps), "uvcloth", path.stem)
    sampling = archive.addTimeSampling(AbcCoreAbstract.TimeSampling(1.0 / animation.fps, 0.0))
    for name, mesh, vertices in zip(animation.names, animation.meshes, animation.vertices, strict=True):
        frames = (np.array(vertices[chunk]) for chunk in animation.chunks())
        _write_mesh(archive, name, mesh, frames, sampling)
    if animation.body is not None:
        _write_mesh(archive, "body", animation.body.mesh, posed_body(animation), sampling)
    del archive
    _settle_metadata(path)


def _settle_metadata(path: Path) -> None:
    """Remove time and locale of writing from a finished file: the same frames give the same bytes."""
    with path.open("r+b") as stream, mmap.mmap(stream.fileno(), 0) as content:
        place = content.rfind(DATE)
        if place >= 0:
            start = place + len(DATE)
            content[start : start + len(NO_DATE)] = NO_DATE
        place = content.rfind(RATE)
        if place >= 0:
            end = content.find(b";", place)
            content[place:end] = content[place:end].replace(b",", b".")


def _reserve(path: Path, animation: Animation) -> None:
    """Raise OSError if the disk has no room for the file: the library aborts where a write fails."""
    meshes = [*animation.meshes, *([animation.body.mesh] if animation.body else [])]
    size = sum(
        len(animation) * len(mesh.vertices) * BYTES_PER_POINT + len(mesh.faces) * BYTES_PER_FACE
        for mesh in meshes
    )
    with path.open("wb") as stream:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(stream.fileno(), 0, size)
    path.unlink()


def _write_mesh(archive: Any, name: str, mesh: Mesh, chunks: Iterator[np.ndarray], sampling: int) -> None:
    """Write one mesh with frames in chunks (B, N, 3) m, Z up; the schema closes with its last reference."""
    import imath
    from alembic3d import AbcGeom

    schema = AbcGeom.OPolyMesh(archive.getTop(), name).getSchema()
    schema.setTimeSampling(sampling)
    # Alembic's faces are clockwise seen from outside.
    polygons = polygons_of(mesh)
    count = len(polygons.sizes)
    polygons = polygons.select(np.arange(count), np.ones(count, dtype=np.bool_))
    topology = [
        imath.IntArrayFromBuffer(np.ascontiguousarray(polygons.corners, np.int32)),
        imath.IntArrayFromBuffer(np.ascontiguousarray(polygons.sizes, np.int32)),
    ]
    if polygons.uv_sets:
        first = polygons.uv_sets[0]
        uvs = np.ascontiguousarray(first.uvs[first.corners], np.float32)
        scope = AbcGeom.GeometryScope.kFacevaryingScope
        topology.append(AbcGeom.OV2fGeomParamSample(imath.V2fArrayFromBuffer(uvs), scope))
    for chunk in chunks:
        for vertices in np.ascontiguousarray(chunk @ TO_Y_UP.T, np.float32):
            points = imath.V3fArrayFromBuffer(vertices)
            if not schema.getNumSamples():
                schema.set(AbcGeom.OPolyMeshSchemaSample(points, *topology))
                continue
            sample = AbcGeom.OPolyMeshSchemaSample()
            sample.setPositions(points)
            schema.set(sample)
