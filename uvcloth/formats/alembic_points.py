"""Alembic: the points of one polygon mesh over time."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvcloth.errors import InputError, cause
from uvcloth.files.reading import require_file
from uvcloth.formats.point_sequence import FROM_Y_UP, MeshQuery, PointSequence, polygon_edges, steady_rate


def read_alembic(path: Path, query: MeshQuery) -> PointSequence:
    """Read one mesh of an archive, in the world: metres with Y up, which the format does not say but all
    programs write.

    Raises InputError naming the file if it cannot be read, holds no such mesh, or alembic3d is missing.
    """
    require_file(path)
    try:
        from alembic3d import Abc
    except ModuleNotFoundError as error:
        raise InputError(f"{path}: reading Alembic needs alembic3d: install uvcloth[alembic]") from error
    try:
        return _read(path, Abc.IArchive(str(path)), query)
    except InputError:
        raise
    except Exception as error:  # The library raises exceptions of many types for a broken file.
        raise InputError(f"{path}: not a readable Alembic file ({cause(error)})") from error


def _read(path: Path, archive: Any, query: MeshQuery) -> PointSequence:
    from alembic3d import Abc

    meshes = list(_meshes(archive.getTop(), "", ()))
    # A whole number is taken for a time, too: samples are chosen by their times.
    first = Abc.ISampleSelector(0.0)
    named = [(name, len(schema.getValue(first).getPositions())) for name, schema, _ in meshes]
    name, schema, above = meshes[query.choose(path, named)]
    sampling = schema.getTimeSampling()
    times = [sampling.getSampleTime(index) for index in range(schema.getNumSamples())]
    frames: list[NDArray[np.float32]] = []
    for time in times:
        points = np.asarray(schema.getValue(Abc.ISampleSelector(time)).getPositions(), np.float64)
        if frames and len(points) != len(frames[0]):
            raise InputError(f"{path}: the number of vertices of {name} changes over time")
        world = _world(above, time)
        frames.append(((points @ world[:3, :3] + world[3, :3]) @ FROM_Y_UP).astype(np.float32))
    sample = schema.getValue(first)
    sizes, corners = (
        np.array(list(each), dtype=np.int64) for each in (sample.getFaceCounts(), sample.getFaceIndices())
    )
    return PointSequence(
        points=np.stack(frames),
        fps=steady_rate(path, np.array(times)),
        edges=polygon_edges(sizes, corners) if len(sizes) else None,
    )


def _meshes(
    parent: Any, above_name: str, above: tuple[Any, ...]
) -> Iterator[tuple[str, Any, tuple[Any, ...]]]:
    """Yield each mesh below an object: its name, its schema and those of the transforms above it.

    A mesh has the name of the transform above it, where it is the only child: programs call the mesh itself
    NAMEShape.
    """
    from alembic3d import AbcGeom

    for child in parent.children:
        header = child.getHeader()
        if AbcGeom.IPolyMesh.matches(header):
            alone = above_name and len(parent.children) == 1
            schema = AbcGeom.IPolyMesh(parent, header.getName()).getSchema()
            if schema.getNumSamples():
                yield above_name if alone else header.getName(), schema, above
        elif AbcGeom.IXform.matches(header):
            schema = AbcGeom.IXform(parent, header.getName()).getSchema()
            yield from _meshes(child, header.getName(), (*above, schema))
        else:
            yield from _meshes(child, "", above)


def _world(above: tuple[Any, ...], time: float) -> NDArray[np.float64]:
    """Product (4, 4) of transforms at a time, for rows of points."""
    from alembic3d import Abc

    world = np.eye(4)
    for schema in above:
        sample = schema.getValue(Abc.ISampleSelector(time))
        world = np.array([list(row) for row in sample.getMatrix()]) @ (
            world if sample.getInheritsXforms() else np.eye(4)
        )
    return world
