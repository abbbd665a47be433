"""Compression of moving points: whole multiples of a step, predicted in time and along the mesh.

Each point's second difference in time is stored relative to that of a neighbour: a few steps where cloth
moves smoothly. These are whole numbers, so that errors do not accumulate: in every frame, and on every
machine, each coordinate is within half a step of the original.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays
from uvcloth.files.fields import Field, check_fields, numbers, whole

QUANTIZATION_STEP = 5.7e-5
"""Step of a coordinate, metres; half the diagonal of such a cube, the largest error, is 0.0494 mm."""

PACKED_ARRAYS = ("changes", "parents", "origin")
"""Names of the arrays that `pack` returns and `unpack` takes."""

MAX_COORDINATE = 1.0e4
"""Metres from the origin within which points are packed."""

MAX_STEPS = round(MAX_COORDINATE / QUANTIZATION_STEP)


def pack(points: np.ndarray, faces: np.ndarray) -> dict[str, np.ndarray]:
    """Pack points (F, N, 3) m of a mesh with faces (M, 3) into arrays that compress well.

    changes: (2, N, 3, F) uint8, the low and high bytes of 16 bits, signs last. parents: (N,) int32, the
    neighbour that each point is predicted by, N for none. origin: (3,) int64 steps, the first point.

    Points that are not finite, beyond MAX_COORDINATE, or jump by more than 16 bits of steps (1.8 m) do not
    fit: changes is then (F, N, 3) float32, the points as they are.
    """
    parents = _parents(faces, points.shape[1])
    origin = np.zeros(3, dtype=np.int64)
    arrays = {"changes": points.astype(np.float32), "parents": parents, "origin": origin}
    if not (np.abs(points) < MAX_COORDINATE).all():
        return arrays
    steps = np.rint(points.astype(np.float64).transpose(1, 2, 0) / QUANTIZATION_STEP).astype(np.int64)
    arrays["origin"] = origin = steps[0, :, 0].copy()
    steps -= origin[:, None]
    speeds = np.diff(steps, axis=2)
    changes = np.concatenate([steps[..., :1], speeds[..., :1], np.diff(speeds, axis=2)], axis=2)
    rooted = parents < len(parents)
    changes[rooted] -= changes[parents[rooted]]
    signed = (changes << 1) ^ (changes >> 63)
    if signed.max(initial=0) < 2**16:
        arrays["changes"] = np.stack([signed & 255, signed >> 8]).astype(np.uint8)
    return arrays


def unpack(changes: np.ndarray, parents: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Unpack the arrays of `pack` into points (F, N, 3) m, float32.

    Raises ValueError if they do not fit together.
    """
    if changes.dtype == np.float32:
        return changes
    low, high = changes
    signed = low | high.astype(np.uint16) << 8
    steps = ((signed >> 1) ^ -(signed & 1)).astype(np.int16).astype(np.int32)
    for level in _levels(parents):
        steps[level] += steps[parents[level]]
    steps[..., 1:].cumsum(axis=2, out=steps[..., 1:])
    steps.cumsum(axis=2, out=steps)
    steps += origin[:, None]
    return np.multiply(steps.transpose(2, 0, 1), QUANTIZATION_STEP, dtype=np.float64).astype(
        np.float32, order="C"
    )


def load_moving(path: Path, format: str, expected: str, fields: Mapping[str, Field]) -> dict[str, np.ndarray]:
    """Read some fields of an npz as `check_fields` does, and its points, unpacked, as "vertices" (F, N, 3) m.

    fields: in which F and N are the sizes of the points. Raises InputError as `load_arrays` and
    `check_fields` do, and for points that do not fit together.
    """
    arrays = load_arrays(path, format, expected)
    packed = arrays.get("changes", np.zeros(0)).dtype == np.uint8
    changes = whole(2, "N", 3, "F", most=255, dtype=np.uint8) if packed else numbers("F", "N", 3)
    points = {"changes": changes, "parents": whole("N"), "origin": whole(3, least=-MAX_STEPS, most=MAX_STEPS)}
    data = check_fields(path, arrays, {**points, **fields})
    count = len(data["parents"])
    if (data["parents"] > count).any():
        raise InputError(f"{path}: parents holds {data['parents'].max()}, expected 0 to {count}")
    try:
        data["vertices"] = unpack(*(data.pop(name) for name in PACKED_ARRAYS))
    except ValueError as error:
        raise InputError(f"{path}: its vertices do not fit together, expected {expected}") from error
    return data


def _parents(faces: np.ndarray, count: int) -> np.ndarray:
    """Neighbour of each point that is closer to the first point of its piece; `count` for that point."""
    start, end = (np.concatenate([faces[:, i] for i in corners]) for corners in ((0, 1, 2), (1, 2, 0)))
    graph = coo_array((np.ones(len(start)), (start, end)), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    roots = np.unique(labels, return_index=True)[1]
    # An extra point is connected to the first of every piece: a single search reaches all pieces.
    start, end = np.concatenate([start, np.full_like(roots, count)]), np.concatenate([end, roots])
    graph = coo_array((np.ones(len(start)), (start, end)), shape=(count + 1, count + 1))
    return breadth_first_order(graph, count, directed=False)[1][:count].astype(np.int32)


def _levels(parents: np.ndarray) -> Iterator[np.ndarray]:
    """Points in the order of their distance, in edges, from the first of their piece, without the first."""
    count = len(parents)
    # Each iteration looks twice as far up; at the end only points in a cycle have not reached the root.
    above, depth = np.append(parents, count), np.append(np.ones(count, dtype=np.int64), 0)
    for _ in range(count.bit_length()):
        depth, above = depth + depth[above], above[above]
    if (above < count).any():
        raise ValueError("points are predicted from each other in a cycle")
    order = np.argsort(depth[:count], kind="stable")
    starts = np.flatnonzero(np.diff(depth[order])) + 1
    yield from np.split(order, starts)[1:]
