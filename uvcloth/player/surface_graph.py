"""Surfaces as graphs in the runtime, edges in compressed rows: distances along them, and edges evened."""

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

    def even_edges(
        self,
        vertices: NDArray[Any],
        curvatures: NDArray[Any],
        normals: NDArray[Any],
        offsets: NDArray[Any],
        passes: int,
    ) -> Floats:
        """Vertices (V, 3) m, moved in so many passes until edges are near the graph's lengths.

        curvatures: (V,) m, lengths of the mean ways to their neighbours at rest. normals: (V, 3) and offsets:
        (V,) m, the least product of a vertex with its normal.
        """
        positions = np.array(vertices, np.float32, order="C")
        limits = [np.ascontiguousarray(each, np.float32) for each in (curvatures, normals, offsets)]
        library().uvc_even_edges(
            ctypes.byref(self._view), *map(pointer, limits), ctypes.c_int(passes), pointer(positions)
        )
        return positions
