"""Moving meshes by the runtime: closest points, the sides of a surface, and edges through faces."""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvcloth.player.handles import make_handle, pointer
from uvcloth.player.library import library

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class SignedClosest:
    """Closest points of a closed mesh for P points.

    faces: (P,) int32, -1 for none within reach. weights: (P, 3) barycentric coordinates there. distances:
    (P,) m, negative inside, the reach for none. places: (P, 3) m, the closest points. normals: (P, 3) the
    unit directions in which the distance grows.
    """

    faces: NDArray[np.int32]
    weights: Floats
    distances: Floats
    places: Floats
    normals: Floats


@dataclass(frozen=True)
class NearestMesh:
    """The mesh that each of P points is deepest in or nearest to, of those that it touches.

    distances: (P,) m, negative inside. normals: (P, 3) and offsets: (P,) m, the plane through the closest
    point, as the product of its points with the normal. gaps: (P,) m, room to the nearest mesh that faces it.
    """

    distances: Floats
    normals: Floats
    offsets: Floats
    gaps: Floats


class MovingMeshes:
    """Triangle meshes over the same moving vertices, in the runtime (uvcloth_measures.h)."""

    def __init__(self, vertices: NDArray[Any], faces: Sequence[NDArray[Any]]) -> None:
        """Copy vertices (V, 3) m and the faces (F, 3) of each mesh, 31 at most; some may have none.

        Raises ValueError with the runtime's sentence for a face with a corner that is no vertex.
        """
        places = np.ascontiguousarray(vertices, np.float32)
        corners = np.ascontiguousarray(np.concatenate([np.zeros((0, 3)), *faces]), np.int32)
        starts = np.cumsum([0, *map(len, faces)], dtype=np.int32)
        arguments = (pointer(places), len(places), pointer(corners), pointer(starts), len(faces))
        self.shape = places.shape
        self._handle = make_handle(self, "uvc_make_meshes", "uvc_free_meshes", *arguments)

    def move(self, vertices: NDArray[Any]) -> None:
        """Move to vertices (V, 3) m."""
        assert vertices.shape == self.shape
        places = np.ascontiguousarray(vertices, np.float32)
        library().uvc_move_meshes(self._handle, pointer(places))

    def closest_faces(
        self, mesh: int, points: NDArray[Any], reach: float
    ) -> tuple[NDArray[np.int32], Floats]:
        """Faces (P,) int32 of a mesh that are closest to points (P, 3) m, and barycentric coordinates (P, 3).

        -1 and 0 where none is within reach, m.
        """
        places, count = np.ascontiguousarray(points, np.float32), len(points)
        faces, weights = np.empty(count, np.int32), np.empty((count, 3), np.float32)
        arguments = (mesh, pointer(places), count, ctypes.c_float(reach))
        library().uvc_closest_faces(self._handle, *arguments, pointer(faces), pointer(weights))
        return faces, weights

    def signed_distances(self, mesh: int, points: NDArray[Any], reach: float) -> SignedClosest:
        """The closest points of a closed mesh for points (P, 3) m, within reach, m."""
        places, count = np.ascontiguousarray(points, np.float32), len(points)
        results = SignedClosest(
            np.empty(count, np.int32),
            np.empty((count, 3), np.float32),
            np.empty(count, np.float32),
            np.empty((count, 3), np.float32),
            np.empty((count, 3), np.float32),
        )
        arguments = (mesh, pointer(places), count, ctypes.c_float(reach))
        library().uvc_signed_distances(self._handle, *arguments, *map(pointer, vars(results).values()))
        return results

    def nearest(
        self, touches: NDArray[Any], points: NDArray[Any], reach: float, exact: float, narrow: float
    ) -> NearestMesh:
        """The mesh that points (P, 3) m are deepest in or nearest to within reach, m, of those they touch.

        touches: (P,) a bit per mesh. exact: m outside a mesh beyond which its distance is a lower bound, not
        below these. narrow: m, least gap that need not be exact.
        """
        places, bits = np.ascontiguousarray(points, np.float32), np.ascontiguousarray(touches, np.int32)
        count = len(places)
        results = NearestMesh(
            np.empty(count, np.float32),
            np.empty((count, 3), np.float32),
            np.empty(count, np.float32),
            np.empty(count, np.float32),
        )
        library().uvc_nearest_meshes(
            self._handle,
            *map(pointer, (bits, places)),
            count,
            *map(ctypes.c_float, (reach, exact, narrow)),
            *map(pointer, vars(results).values()),
        )
        return results

    def crossing_edges(self, mesh: int, edges: NDArray[Any]) -> NDArray[np.bool_]:
        """Mask (E,) of the edges (E, 2) between vertices that run through a face of a mesh.

        A face with a corner at the place of either end does not count.
        """
        ends, crosses = np.ascontiguousarray(edges, np.int32), np.empty(len(edges), np.bool_)
        library().uvc_crossing_edges(self._handle, mesh, pointer(ends), len(ends), pointer(crosses))
        return crosses
