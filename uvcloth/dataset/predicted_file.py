"""Files of other programs, read and compared with the sequence that they predict."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.dataset.clip import REST_TOLERANCE, SimulatedGarment
from uvcloth.dataset.clip_file import SEQUENCE_FORMAT, load_simulated
from uvcloth.errors import InputError
from uvcloth.files.archive import read_arrays
from uvcloth.files.fields import check_fields, numbers
from uvcloth.formats.alembic_points import read_alembic
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.formats.point_cache import read_mdd, read_pc2
from uvcloth.formats.point_npz import read_npz
from uvcloth.formats.point_sequence import FROM_Y_UP, MeshQuery, PointSequence
from uvcloth.formats.usd_points import read_usd
from uvcloth.geometry.mesh import edge_lengths, unique_edges

SIZE = 2.0
"""Ratio of sizes in the first frame from which a garment is in another unit."""

FAR, TURNED = 0.3, 0.2
"""Metres from the simulated garment in the first frame beyond which other axes are tried, and the share of
that distance below which they fit."""

LONGEST, TORN = 4.0, 0.1
"""A first frame is of another order where more than the share TORN of its edges is longer than LONGEST times
their length at rest, ..."""

ALIKE = 0.5
"""... or where the correlation of its vertices with the simulated ones is lower."""

OTHER_AXES = {
    "Y up": FROM_Y_UP,
    "Y up, left-handed": np.array([[1, 0, 0], [0, 0, 1], [0, 1, 0]], np.float64),
}
"""Matrices for rows of points, from axes that programs write to Z up."""


def _read_npz(path: Path, query: MeshQuery) -> PointSequence:
    """Read an npz of any program, or a sequence of this one."""
    stored = read_arrays(path, "an npz of vertices over time", ("format",)).get("format")
    if str(stored) != SEQUENCE_FORMAT:
        return read_npz(path, query)
    clip = load_simulated(path)
    (garment,) = clip.garments
    return PointSequence(
        garment.vertices.numpy(), clip.fps, unique_edges(garment.faces).numpy(), garment.rest.numpy()
    )


READERS: Mapping[str, Callable[[Path, MeshQuery], PointSequence]] = {
    ".npz": _read_npz,
    ".pc2": lambda path, _: read_pc2(path),
    ".mdd": lambda path, _: read_mdd(path),
    ".abc": read_alembic,
    ".usd": read_usd,
    ".usda": read_usd,
    ".usdc": read_usd,
}
"""Readers of the files of other programs, by suffix."""


def find_file(folder: Path, stem: str) -> Path | None:
    """The file of a sequence in a folder, None without one. Raises InputError if there are two."""
    paths = [folder / f"{stem}{suffix}" for suffix in READERS]
    there = [path for path in paths if path.is_file()]
    if len(there) > 1:
        raise InputError(f"{there[0]}: {there[1].name} beside it is of the same sequence, keep one of them")
    return there[0] if there else None


def read_milliseconds(path: Path) -> float | None:
    """Read the milliseconds a frame that a program took, `ms_per_frame` of an npz; None without them.

    Raises InputError naming the file if that is no number from 0 on.
    """
    if path.suffix != ".npz":
        return None
    arrays = read_arrays(path, "an npz of vertices over time", ("ms_per_frame",))
    data = check_fields(path, arrays, {"ms_per_frame": numbers(least=0.0).if_there()})
    return float(data["ms_per_frame"]) if data else None


def read_prediction(path: Path, simulated: SimulatedGarment, fps: float, skipped: int = 0) -> Tensor:
    """Read the vertices (F, N, 3) m of a garment, with Z up, for all frames of its simulation.

    fps: frames per second of the simulation. skipped: frames of its beginning that the file may lack; fewer
    are returned then. Raises InputError naming the file if it is damaged, or differs
    in the number of vertices or frames, the frame rate, the mesh, the rest pose, the unit or the axes, or
    holds a number that is not finite.
    """
    frames, vertices, _ = simulated.vertices.shape
    sequence = READERS[path.suffix](path, MeshQuery(simulated.name, vertices))
    points = torch.from_numpy(sequence.points)
    if not len(points):
        raise InputError(f"{path}: holds no frame, expected {frames}")
    if points.shape[1] != vertices:
        raise InputError(
            f"{path}: has {points.shape[1]:,} vertices, the garment {simulated.name} has {vertices:,}"
        )
    lacking = frames - len(points)
    if lacking not in (0, skipped):
        raise InputError(
            f"{path}: has {len(points)} frames, expected all {frames} of the simulation, warm-up included"
        )
    if sequence.fps is not None and abs(sequence.fps - fps) > 0.01 * fps:
        raise InputError(f"{path}: has {sequence.fps:.4g} frames per second, expected {fps:.4g}")
    _require_finite(path, points)
    if sequence.edges is not None:
        _require_edges(path, sequence.edges, simulated)
    rest = _rest(path, sequence)
    if rest is not None:
        _require_rest(path, rest, simulated)
    _require_place(path, points[0], simulated, lacking)
    return points


def _require_finite(path: Path, points: Tensor) -> None:
    broken = torch.nonzero(~points.isfinite().all(-1))
    if len(broken):
        frame, vertex = broken[0].tolist()
        raise InputError(f"{path}: vertex {vertex} is not a finite number in frame {frame}")


def _require_edges(path: Path, edges: NDArray[np.int64], simulated: SimulatedGarment) -> None:
    """Raise InputError if a polygon has an edge (E, 2) that the garment does not have.

    Triangles may have been joined to larger polygons: these have fewer edges.
    """
    garment = unique_edges(simulated.faces).numpy()
    keys, known = ((each[:, 0] << 32) + each[:, 1] for each in (edges, garment))
    other = edges[~np.isin(keys, known)]
    if len(other):
        first, second = other[0].tolist()
        raise InputError(
            f"{path}: its mesh is of another order than the garment {simulated.name}, "
            f"which has no edge from vertex {first} to {second}"
        )


def _rest(path: Path, sequence: PointSequence) -> Tensor | None:
    """Vertices (N, 3) at rest, m: those of the file, or of an OBJ of the same name beside it, or None."""
    beside = path.with_suffix(".obj")
    if sequence.rest is None and beside.is_file():
        return read_mesh(beside).vertices.float()
    return None if sequence.rest is None else torch.from_numpy(sequence.rest)


def _require_rest(path: Path, rest: Tensor, simulated: SimulatedGarment) -> None:
    if rest.shape != simulated.rest.shape:
        raise InputError(
            f"{path}: has {len(rest):,} vertices at rest, the garment {simulated.name} has "
            f"{len(simulated.rest):,}"
        )
    _require_unit(path, rest, simulated.rest, "at rest")
    apart = float((rest - simulated.rest).norm(dim=1).max())
    if not apart <= REST_TOLERANCE:
        raise InputError(
            f"{path}: at rest it is up to {1000 * apart:.0f} mm from the garment {simulated.name}; it has "
            "another shape, order of vertices or pose"
        )


def _require_place(path: Path, first: Tensor, simulated: SimulatedGarment, frame: int) -> None:
    """Raise InputError if the first frame (N, 3) looks like another unit, other axes or another order.

    frame: of the simulation.
    """
    expected = simulated.vertices[frame]
    _require_unit(path, first, expected, "in its first frame")
    apart = float((first - expected).norm(dim=1).mean())
    for axes, matrix in OTHER_AXES.items():
        turned = first @ torch.from_numpy(matrix).to(first)
        if apart > FAR and (turned - expected).norm(dim=1).mean() < TURNED * apart:
            raise InputError(f"{path}: its axes look like {axes}, expected Z up")
    edges = unique_edges(simulated.faces)
    longer = edge_lengths(first, edges) > LONGEST * edge_lengths(simulated.rest, edges)
    centred, usual = first - first.mean(0), expected - expected.mean(0)
    likeness = float((centred * usual).sum() / (centred.norm() * usual.norm()))
    if longer.float().mean() > TORN or likeness < ALIKE:
        raise InputError(
            f"{path}: its first frame does not look like the garment {simulated.name}, its mesh is of "
            "another order"
        )


def _require_unit(path: Path, points: Tensor, expected: Tensor, when: str) -> None:
    """Raise InputError if points (N, 3) are much larger or smaller than expected."""
    size, usual = (float((each - each.mean(0)).norm(dim=1).mean()) for each in (points, expected))
    if not usual / SIZE <= size <= usual * SIZE:
        raise InputError(
            f"{path}: {when} it is {size / usual:.3g} times as large as the simulation, expected metres"
        )
