"""Lossy compression of moving meshes: a cosine transform in time, the mesh's spectrum in space, quantized.

Both transforms are orthonormal, so that the squared error of the points is that of the coefficients. Nearly
all coefficients of smoothly moving cloth are below one quantization step. Frames are transformed in blocks,
as motion changes within a second, and the mesh in two halves, as a bodice moves less than a skirt. The steps
are as coarse as an error allows; single points with a large error are corrected.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import dct, idct
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import eigsh

from uvcloth.formats.entropy import decode, encode

MOST_POINTS = 6000
"""Limit for the points of a mesh: its spectrum takes half a minute then, and the time grows with their third
power.
"""

BLOCK = 25
"""Approximate number of frames of a block."""

MOST_OF_99, MOST_OF_ALL = 3.0, 6.0
"""Largest errors of 99 % of the points, and of all, as multiples of the mean error that is allowed."""

ROUNDED_FROM = 0.6
"""Fraction of a step from which a coefficient is rounded up: less costs more to keep than it corrects."""

STEPS = np.exp2(np.arange(-16, 41) / 8.0)
"""Steps that are tried, as multiples of the mean error that is allowed."""

GOLDEN = 0.6180339887498949
UNEVENNESS = 0.4
"""Range of the edges' weights, which differ so that all eigenvalues do, even on a symmetric mesh."""


@dataclass(frozen=True)
class Patch:
    """Part of a mesh: points (n,), indices in the mesh, and waves (n, n), its spectrum as columns."""

    points: np.ndarray
    waves: np.ndarray


@dataclass(frozen=True)
class CodedPoints:
    """Moving points in coded form.

    step: quantization step of the coefficients, m. code: (B,) uint8, the coefficients. gaps: (R,) from each
    corrected point to the next, in the order of frames and points. corrections: (R, 3) in multiples of the
    mean error.
    """

    step: float
    code: np.ndarray
    gaps: np.ndarray
    corrections: np.ndarray


def second_half(faces: np.ndarray, count: int) -> np.ndarray:
    """Flags (N,) of the points of the second of two halves of a mesh that few edges connect.

    They are divided at the median of the Fiedler vector, the second eigenvector of the graph Laplacian.
    """
    if count < 4:
        return np.zeros(count, bool)
    edges = _edges(faces)
    weights = np.ones(len(edges))
    graph = coo_array((weights, (edges[:, 0], edges[:, 1])), shape=(count, count))
    graph = graph + graph.T
    laplacian = diags_array(graph.sum(axis=1) + 1e-3 * _series(count)) - graph
    # A fixed start, so that the same mesh is always divided alike.
    waves = eigsh(laplacian.tocsc(), k=2, sigma=-1e-3, v0=1.0 + _series(count))[1]
    second = np.zeros(count, bool)
    second[np.argsort(waves[:, 1], kind="stable")[count // 2 :]] = True
    return second


def part_spectra(faces: np.ndarray, second: np.ndarray) -> tuple[Patch, ...]:
    """Spectra of the two halves of a mesh with faces (M, 3), without a half that has no points.

    second: (N,) flags of the points of the second half. Long waves come first. Edges have different weights,
    a fixed series, so that every eigenvalue is single: its vector is then the same on every machine, to
    rounding, once its sign is fixed.
    """
    edges, parts = _edges(faces), []
    for half in (~second, second):
        points = np.flatnonzero(half)
        if len(points):
            place = np.cumsum(half) - 1
            parts.append(Patch(points, _spectrum(place[edges[half[edges].all(axis=1)]], len(points))))
    return tuple(parts)


def code_points(points: np.ndarray, parts: tuple[Patch, ...], error: float) -> CodedPoints:
    """Code points (F, N, 3) m of a mesh in the coarsest steps that a mean error, m, allows.

    The mean distance from the original points is at most `error`; 99 % of the distances are at most
    MOST_OF_99 times, and all at most MOST_OF_ALL times `error`. Raises ValueError for points that are not
    finite or too far.
    """
    if not np.isfinite(points).all():
        raise ValueError("points are not finite")
    coefficients = _in_time(_in_space(points.astype(np.float64), parts))
    low, high = 0, len(STEPS)
    while high - low > 1:
        middle = (low + high) // 2
        step = STEPS[middle] * error
        decoded = _from_steps(_to_steps(coefficients, step), step, parts, points.shape[1])
        distances = np.linalg.norm(decoded - points, axis=-1)
        allowed = distances.mean() <= error and np.percentile(distances, 99) <= MOST_OF_99 * error
        low, high = (middle, high) if allowed else (low, middle)
    step = float(STEPS[low] * error)
    steps = _to_steps(coefficients, step)
    off = (points - _from_steps(steps, step, parts, points.shape[1])).reshape(-1, 3)
    corrected = np.flatnonzero(np.linalg.norm(off, axis=1) > MOST_OF_ALL * error)
    return CodedPoints(
        step,
        encode(steps, _blocks(len(points))),
        np.diff(corrected, prepend=0),
        np.rint(off[corrected] / error).astype(np.int64),
    )


def decode_points(
    coded: CodedPoints, parts: tuple[Patch, ...], error: float, frames: int, count: int
) -> np.ndarray:
    """Decode points (F, N, 3) m, float64, that `code_points` coded with the same mean error.

    Raises ValueError for code of other frames or points.
    """
    longest = max(len(part.points) for part in parts)
    steps = decode(coded.code, (frames, longest, 3 * len(parts)), _blocks(frames))
    points = _from_steps(steps, coded.step, parts, count)
    corrected = coded.gaps.cumsum()
    if (coded.gaps < 0).any() or (corrected >= frames * count).any():
        raise ValueError("corrections belong to other points")
    points.reshape(-1, 3)[corrected] += coded.corrections * error
    return points


def _edges(faces: np.ndarray) -> np.ndarray:
    pairs = np.concatenate([faces[:, corners] for corners in ([0, 1], [1, 2], [2, 0])])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def _spectrum(edges: np.ndarray, count: int) -> np.ndarray:
    """Eigenvectors, as columns (N, N), of the Laplacian of edges (E, 2) between points."""
    weights = 1.0 + UNEVENNESS * (_series(len(edges)) - 0.5)
    laplacian = np.zeros((count, count))
    laplacian[edges[:, 0], edges[:, 1]] = laplacian[edges[:, 1], edges[:, 0]] = -weights
    # The diagonal also separates the eigenvalues of points without edges.
    laplacian[np.diag_indices(count)] = 1e-3 * _series(count) - laplacian.sum(axis=1)
    # Of numpy: scipy's holds the interpreter for seconds, in which Ctrl-C is not heard.
    vectors = np.linalg.eigh(laplacian)[1]
    return np.copysign(1.0, (_series(count) - 0.5) @ vectors) * vectors


def _in_space(points: np.ndarray, parts: tuple[Patch, ...]) -> np.ndarray:
    """Coefficients (F, K, 3 P) of points (F, N, 3); those that a part lacks are zero."""
    frames, longest = len(points), max(len(part.points) for part in parts)
    coefficients = np.zeros((frames, longest, 3 * len(parts)))
    for place, part in enumerate(parts):
        columns = points[:, part.points].transpose(1, 0, 2).reshape(len(part.points), -1)
        waves = (part.waves.T @ columns).reshape(-1, frames, 3).transpose(1, 0, 2)
        coefficients[:, : len(part.points), 3 * place : 3 * place + 3] = waves
    return coefficients


def _from_steps(steps: np.ndarray, step: float, parts: tuple[Patch, ...], count: int) -> np.ndarray:
    """Points (F, N, 3) of coefficients (F, K, 3 P) in steps, low frequencies first."""
    frames = len(steps)
    in_space, points = _out_of_time(steps * step), np.empty((frames, count, 3))
    for place, part in enumerate(parts):
        waves = in_space[:, : len(part.points), 3 * place : 3 * place + 3]
        columns = part.waves @ waves.transpose(1, 0, 2).reshape(len(part.points), -1)
        points[:, part.points] = columns.reshape(-1, frames, 3).transpose(1, 0, 2)
    return points


def _blocks(frames: int) -> int:
    return max(1, round(frames / BLOCK))


def _order(frames: int) -> tuple[np.ndarray, np.ndarray]:
    """First frames (blocks + 1,) of the blocks, and the order (F,) of coefficients by frequency and block."""
    starts = np.linspace(0, frames, _blocks(frames) + 1).round().astype(np.int64)
    frequencies = np.arange(frames) - np.repeat(starts[:-1], np.diff(starts))
    return starts, np.argsort(frequencies, kind="stable")


def _in_time(values: np.ndarray) -> np.ndarray:
    """Cosine transform, block by block, of values (F, ...), low frequencies of all blocks first."""
    starts, order = _order(len(values))
    blocks = [dct(block, axis=0, norm="ortho") for block in np.split(values, starts[1:-1])]
    return np.concatenate(blocks)[order]


def _out_of_time(coefficients: np.ndarray) -> np.ndarray:
    starts, order = _order(len(coefficients))
    sorted_back = np.empty_like(coefficients)
    sorted_back[order] = coefficients
    return np.concatenate(
        [idct(block, axis=0, norm="ortho") for block in np.split(sorted_back, starts[1:-1])]
    )


def _to_steps(coefficients: np.ndarray, step: float) -> np.ndarray:
    sizes = np.floor(np.abs(coefficients) / step + 1.0 - ROUNDED_FROM)
    return np.copysign(sizes, coefficients).astype(np.int64)


def _series(count: int) -> np.ndarray:
    """Distinct numbers (count,) from 0 to 1: fractional parts of multiples of the golden ratio."""
    return np.modf(np.arange(1, count + 1) * GOLDEN)[0]
