"""Meshes over time from other programs, as points by vertex order: npz, PC2, MDD, Alembic and USD."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uvcloth.errors import InputError

FROM_Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], np.float64)
"""Rows (x, y, z) with Y up, times this, have Z up: (x, -z, y)."""


@dataclass(frozen=True)
class PointSequence:
    """F frames of N points, metres, Z up.

    points: (F, N, 3) float32. The others are None where the file does not hold them: fps: frames per second.
    edges: (E, 2) int64 of its polygons, each once, lower index first. rest: (N, 3) at rest.
    """

    points: NDArray[np.float32]
    fps: float | None = None
    edges: NDArray[np.int64] | None = None
    rest: NDArray[np.float32] | None = None


@dataclass(frozen=True)
class MeshQuery:
    """The mesh to read of a file that may hold several: the one of this name, or the only one of so many
    vertices.
    """

    name: str
    vertices: int

    def choose(self, path: Path, meshes: list[tuple[str, int]]) -> int:
        """Index of the mesh among all of a file, each with its name and number of vertices.

        Raises InputError naming the file if none fits, or several do.
        """
        named = [index for index, (name, _) in enumerate(meshes) if name == self.name]
        alike = [index for index, (_, count) in enumerate(meshes) if count == self.vertices]
        fitting = named if len(named) == 1 else alike
        if len(fitting) == 1:
            return fitting[0]
        there = ", ".join(f"{name} ({count:,})" for name, count in meshes[:8]) or "no mesh"
        raise InputError(
            f"{path}: expected one mesh called {self.name}, or with its {self.vertices:,} vertices; "
            f"the file holds {there}"
        )


def polygon_edges(sizes: NDArray[np.int64], corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges (E, 2) of polygons, each once, lower index first. sizes: (P,) corners of each; corners: (C,)."""
    starts = np.cumsum(sizes) - sizes
    following = np.arange(1, len(corners) + 1)
    following[starts[sizes > 0] + sizes[sizes > 0] - 1] = starts[sizes > 0]
    return np.unique(np.sort(np.stack([corners, corners[following]], axis=1), axis=1), axis=0)


def steady_rate(path: Path, times: NDArray[np.float64]) -> float | None:
    """Frames per second of times in seconds, (F,); None for fewer than two.

    Raises InputError naming the file if they do not increase evenly.
    """
    steps = np.diff(times)
    if not len(steps):
        return None
    usual = float(np.median(steps))
    if not usual > 0 or not (abs(steps - usual) <= 0.01 * usual).all():
        raise InputError(
            f"{path}: its frames are not evenly spaced in time, expected one frame after another"
        )
    return 1.0 / usual
