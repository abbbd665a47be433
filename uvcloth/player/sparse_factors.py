"""Sparse symmetric systems by the runtime, whose factors are known: eight columns at a time."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvcloth.player.handles import pointer
from uvcloth.player.library import library


class _View(ctypes.Structure):
    _fields_ = [
        ("starts", ctypes.c_void_p),
        ("rows", ctypes.c_void_p),
        ("values", ctypes.c_void_p),
        ("pivots", ctypes.c_void_p),
        ("size", ctypes.c_int32),
        ("parts", ctypes.c_int32),
    ]


class SparseFactors:
    """Factors L D L^T of a symmetric matrix (n, n), real or complex."""

    def __init__(
        self, starts: NDArray[Any], rows: NDArray[Any], values: NDArray[Any], pivots: NDArray[Any]
    ) -> None:
        """Keep what is below the diagonal of L, which is 1: in column k the values from starts[k] to
        starts[k + 1], in rows. pivots: (n,), the diagonal D.
        """
        self._starts, self._rows = (np.ascontiguousarray(each, np.int32) for each in (starts, rows))
        self._complex = bool(np.iscomplexobj(values))
        kind = np.complex128 if self._complex else np.float64
        self._values, self._pivots = (np.ascontiguousarray(each, kind) for each in (values, pivots))
        arrays: list[NDArray[Any]] = [self._starts, self._rows, self._values, self._pivots]
        self._view = _View(*map(pointer, arrays), len(self._pivots), 2 if self._complex else 1)

    def solve(self, columns: NDArray[Any]) -> NDArray[Any]:
        """Solve L D L^T x = b for columns (n, C)."""
        if self._complex:
            solved = np.ascontiguousarray(np.stack([columns.real, columns.imag], axis=1), np.float64)
        else:
            solved = np.array(columns, np.float64, order="C")
        library().uvc_solve_columns(ctypes.byref(self._view), pointer(solved), columns.shape[1])
        return solved[:, 0] + 1j * solved[:, 1] if self._complex else solved
