"""Lossy compression of moving meshes: cosines in time, the spectrum of the mesh in space, in whole steps.

A transform whose rows are orthonormal loses no more in the sum of squares than its coefficients do, and of
cloth that moves smoothly nearly all coefficients are less than a step: the cosines of `rasterize.moving`'s
exact differences take five times as much.
"""

import numpy as np
from scipy.fft import dct, idct
from scipy.linalg import eigh

STEP = 0.003
"""Metres of a coefficient's step."""

MOST_POINTS = 6000
"""Points of a mesh whose spectrum is worth its time, a minute: it grows with their third power."""

PLANES = 3
"""Bytes of a coefficient."""

MOST_STEPS = 2 ** (8 * PLANES - 1) - 1

GOLDEN = 0.6180339887498949
UNEVENNESS = 0.4
"""How far edges' weights are apart, so that no two wavelengths are the same, even of a symmetric mesh."""


def mesh_spectrum(faces: np.ndarray, count: int) -> np.ndarray:
    """Eigenvectors of the Laplacian of a mesh with faces (M, 3) and `count` points, as columns (N, N).

    Long waves come first. Edges have different weights, a fixed series, so that every eigenvalue is single:
    its vector is then the same on every machine, to rounding, once its sign is fixed.
    """
    pairs = np.concatenate([faces[:, corners] for corners in ([0, 1], [1, 2], [2, 0])])
    edges = np.unique(np.sort(pairs, axis=1), axis=0)
    weights = 1.0 + UNEVENNESS * (_series(len(edges)) - 0.5)
    laplacian = np.zeros((count, count))
    laplacian[edges[:, 0], edges[:, 1]] = laplacian[edges[:, 1], edges[:, 0]] = -weights
    # Points that no edge reaches differ too, by what is on the diagonal.
    laplacian[np.diag_indices(count)] = 1e-3 * _series(count) - laplacian.sum(axis=1)
    vectors = eigh(laplacian, overwrite_a=True, check_finite=False)[1]
    return np.copysign(1.0, (_series(count) - 0.5) @ vectors) * vectors


def compress(points: np.ndarray, spectrum: np.ndarray, step: float = STEP) -> np.ndarray:
    """Compress points (F, N, 3) m to coefficients (PLANES, N, 3, F) uint8, low bytes first, signs last.

    Raises ValueError for points that are not finite, and for coefficients beyond MOST_STEPS.
    """
    if not np.isfinite(points).all():
        raise ValueError("points are not finite")
    in_time = dct(points.astype(np.float64), axis=0, norm="ortho")
    in_space = spectrum.T @ in_time.transpose(1, 2, 0).reshape(len(spectrum), -1)
    return to_planes(np.rint(in_space / step).astype(np.int64).reshape(len(spectrum), 3, -1))


def decompress(coefficients: np.ndarray, spectrum: np.ndarray, step: float = STEP) -> np.ndarray:
    """Points (F, N, 3) m, float64, of coefficients (PLANES, N, 3, F)."""
    in_time = spectrum @ (from_planes(coefficients).reshape(len(spectrum), -1) * step)
    return idct(in_time.reshape(len(spectrum), 3, -1), axis=2, norm="ortho").transpose(2, 0, 1)


def to_planes(steps: np.ndarray) -> np.ndarray:
    """Whole numbers (...) as bytes (PLANES, ...), low ones first, signs last, which compress well.

    Raises ValueError for more than MOST_STEPS.
    """
    if not np.abs(steps).max(initial=0) <= MOST_STEPS:
        raise ValueError("points are too far away, or too fast")
    signed = (steps << 1) ^ (steps >> 63)
    return np.stack([signed >> 8 * plane & 255 for plane in range(PLANES)]).astype(np.uint8)


def from_planes(planes: np.ndarray) -> np.ndarray:
    """Whole numbers (...), int64, of bytes (PLANES, ...)."""
    signed = sum(plane.astype(np.int64) << 8 * place for place, plane in enumerate(planes))
    return (signed >> 1) ^ -(signed & 1)


def _series(count: int) -> np.ndarray:
    """Numbers (count,) from 0 to 1 of which no two are the same: the golden ratio's multiples."""
    return np.modf(np.arange(1, count + 1) * GOLDEN)[0]
