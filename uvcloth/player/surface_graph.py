"""Distances along a surface by the runtime: its edges are a graph in compressed rows."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvcloth.player.handles import pointer
from uvcloth.player.library import library

Floats = NDArray[np.float32]


class _View(ctypes.Structure):
    _fields_ = [
        ("starts", ctypes.c_void_p),
        ("neighbours", ctypes.c_void_p),
        ("lengths", ctypes.c_void_p),
        ("vertices", ctypes.c_int32),
    ]


class SurfaceGraph:
    """Edges of a surface of V vertices."""

    def __init__(self, starts: NDArray[Any], neighbours: NDArray[Any], lengths: NDArray[Any]) -> None:
        """Keep the neighbours of each vertex, from starts (V + 1,) on, and the lengths, m, of the edges."""
        self._starts, self._neighbours = (
            np.ascontiguousarray(each, np.int32) for each in (starts, neighbours)
        )
        self._lengths = np.ascontiguousarray(lengths, np.float32)
        self.vertices = len(starts) - 1
        self._view = _View(
            *(pointer(each) for each in (self._starts, self._neighbours, self._lengths)), self.vertices
        )

    def thin_out(self, order: NDArray[Any], spacing: float) -> Floats:
        """Choose vertices, in a given order (N,), that are at least spacing, m, apart along the surface.

        Returns (V,) m: for each chosen vertex the distance within which others were left out for it, -1 for
        all others.
        """
        sources, clear = np.ascontiguousarray(order, np.int32), np.empty(self.vertices, np.float32)
        library().uvc_thin_out(
            ctypes.byref(self._view), pointer(sources), len(sources), ctypes.c_float(spacing), pointer(clear)
        )
        return clear
