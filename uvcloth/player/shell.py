"""Moving meshes by the runtime: points on them, and rays that meet them."""

import ctypes
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from uvcloth.player.handles import make_handle, pointer
from uvcloth.player.library import library

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class RayHits:
    """First faces that R rays meet.

    faces: (R,) int32, -1 for none. distances: (R,) m, 1e9 for none. cosines: (R,) between ray and normal,
    negative from outside. weights: (R, 3) barycentric coordinates; both are 0 for none.
    """

    faces: NDArray[np.int32]
    distances: Floats
    cosines: Floats
    weights: Floats


class MovingShell:
    """A triangle mesh that moves, open or closed, in the runtime (uvcloth_measures.h)."""

    def __init__(self, vertices: NDArray[Any], faces: NDArray[Any]) -> None:
        """Copy vertices (V, 3) m and faces (F, 3).

        Raises ValueError with the runtime's sentence for a face with a corner that is no vertex.
        """
        self.vertices = np.ascontiguousarray(vertices, np.float32)
        self.faces = np.ascontiguousarray(faces, np.int32)
        sizes = len(self.vertices), len(self.faces)
        arguments = (pointer(self.vertices), sizes[0], pointer(self.faces), sizes[1])
        self._handle = make_handle(self, "uvc_make_shell", "uvc_free_shell", *arguments)

    def __reduce__(self) -> tuple[type[Self], tuple[Floats, NDArray[np.int32]]]:
        """Pickle the mesh as it lies now."""
        return type(self), (self.vertices, self.faces)

    def move(self, vertices: NDArray[Any]) -> None:
        """Move to vertices (V, 3) m."""
        assert vertices.shape == self.vertices.shape
        self.vertices = np.ascontiguousarray(vertices, np.float32)
        library().uvc_move_shell(self._handle, pointer(self.vertices))

    def first_hits(self, starts: NDArray[Any], directions: NDArray[Any], reach: float) -> RayHits:
        """The first faces that rays from starts along unit directions, (R, 3) each, meet within reach, m.

        Eight rays in a row are followed together, so they should lie together.
        """
        assert starts.shape == directions.shape
        starts, directions = (np.ascontiguousarray(each, np.float32) for each in (starts, directions))
        count = len(starts)
        faces, weights = np.empty(count, np.int32), np.empty((count, 3), np.float32)
        distances, cosines = np.empty(count, np.float32), np.empty(count, np.float32)
        library().uvc_first_hits(
            self._handle,
            *map(pointer, (starts, directions)),
            count,
            ctypes.c_float(reach),
            *map(pointer, (faces, distances, cosines, weights)),
        )
        return RayHits(faces, distances, cosines, weights)


def sample(vertices: NDArray[Any], faces: NDArray[Any], weights: NDArray[Any]) -> tuple[Floats, Floats]:
    """Points (P, 3) m of a mesh with vertices (V, 3) m, and the unit normals (P, 3) of their faces.

    faces: (P, 3), the face of each point. weights: (P, 3) barycentric coordinates there.
    """
    places, shares = (np.ascontiguousarray(each, np.float32) for each in (vertices, weights))
    corners, count = np.ascontiguousarray(faces, np.int32), len(faces)
    points, normals = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
    library().uvc_sample(*map(pointer, (places, corners, shares)), count, *map(pointer, (points, normals)))
    return points, normals
