"""The cloth solver of the runtime: elastic forces, and steps of a frame (uvcloth.h)."""

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from uvcloth.player.handles import MESSAGE_ROOM, pointer, read_outfit
from uvcloth.player.library import library
from uvcloth.player.sections import pack

Floats = NDArray[np.float32]
Integers = NDArray[np.int32]

GRAVITY = (0.0, 0.0, -9.81)
"""m/s2."""


@dataclass(frozen=True)
class Pairs:
    """Parts of cloth that are near each other, with the sides on which they stay.

    points: (P, 2) a vertex and a face. sides: (P,), +1 or -1 along the normal of the face. edges: (Q, 2) two
    edges. directions: (Q, 3), unit, from the second edge to the first.
    """

    points: Integers
    sides: Floats
    edges: Integers
    directions: Floats


def no_pairs() -> Pairs:
    """No pairs."""
    none = np.zeros((0, 2), np.int32)
    return Pairs(none, np.zeros(0, np.float32), none, np.zeros((0, 3), np.float32))


@dataclass(frozen=True)
class ContactCache:
    """Results of the searches of a frame for the next one, for each of K parts and N vertices of cloth.

    faces: (K, N) the closest face, -1 for none. clear: (K, N) m, a distance within which there is none.
    """

    faces: Integers
    clear: Floats


def nothing_searched(parts: int, vertices: int) -> ContactCache:
    """Search results before the first frame."""
    return ContactCache(np.full((parts, vertices), -1, np.int32), np.zeros((parts, vertices), np.float32))


class MotionFields(ctypes.Structure):
    """The struct uvc_motion of uvcloth.h, field by field."""

    _fields_ = (
        *(
            (name, ctypes.c_void_p)
            for name in ("body_start", "body_end", "target_start", "target_end", "pull", "damping")
        ),
        ("acceleration", ctypes.c_void_p),
        *((name, ctypes.c_float * 3) for name in ("drift", "gravity")),
        *((name, ctypes.c_float) for name in ("seconds", "radius", "self_radius", "fold_radius")),
        *((name, ctypes.c_float) for name in ("self_margin", "reach", "needed", "interval")),
        *((name, ctypes.c_int32) for name in ("hinge_interval", "frame", "renewal", "self_contact")),
    )


class ClothSolver:
    """Cloth and the body that it collides with, in the runtime."""

    def __init__(self, content: bytes) -> None:
        """Read packed sections. Raises ValueError with the runtime's sentence if they do not fit together."""
        self._content = content
        self._handle = read_outfit(self, content, "uvc_read_solver", "uvc_free_solver")

    def __reduce__(self) -> tuple[type[Self], tuple[bytes]]:
        """Pickle the sections; the runtime reads them again."""
        return type(self), (self._content,)

    @classmethod
    def of(cls, sections: Mapping[str, NDArray[Any]]) -> Self:
        """Read sections by their names, as runtime/src/solver.h lists them."""
        return cls(pack(sections))

    def step(
        self,
        arrays: Mapping[str, Floats | None],
        numbers: Mapping[str, float],
        drift: NDArray[np.float64],
        positions: Floats,
        velocities: Floats,
        pairs: Pairs,
        searched: ContactCache,
    ) -> tuple[Floats, Floats, Pairs, ContactCache, int] | None:
        """Move positions (N, 3) m and velocities (N, 3) m/s through a frame.

        arrays, numbers, drift: the fields of uvc_motion by their names. Returns what comes after and the
        substeps of the frame, or None for cloth that flies apart. Raises ValueError with the runtime's
        sentence for a body that is too fast.
        """
        places, speeds = positions.copy(), velocities.copy()
        faces, clear = searched.faces.copy(), searched.clear.copy()
        motion = MotionFields(**numbers)
        motion.drift, motion.gravity = (ctypes.c_float * 3)(*drift), (ctypes.c_float * 3)(*GRAVITY)
        kept = {name: np.ascontiguousarray(a, np.float32) for name, a in arrays.items() if a is not None}
        for name, array in kept.items():
            setattr(motion, name, pointer(array))
        core = library()
        handle = ctypes.c_void_p(core.uvc_make_pairs())
        try:
            core.uvc_set_pairs(
                handle,
                pointer(pairs.points),
                pointer(pairs.sides),
                len(pairs.points),
                pointer(pairs.edges),
                pointer(pairs.directions),
                len(pairs.edges),
            )
            message = ctypes.create_string_buffer(MESSAGE_ROOM)
            substeps = core.uvc_solve(
                self._handle,
                ctypes.byref(motion),
                pointer(places),
                pointer(speeds),
                pointer(faces),
                pointer(clear),
                handle,
                message,
                ctypes.c_size_t(MESSAGE_ROOM),
            )
            after = _pairs(core, handle)
        finally:
            core.uvc_free_pairs(handle)
        if substeps < 0:
            raise ValueError(message.value.decode())
        return (places, speeds, after, ContactCache(faces, clear), substeps) if substeps else None


def _pairs(core: ctypes.CDLL, handle: ctypes.c_void_p) -> Pairs:
    """Copy pairs out of the runtime."""
    points, edges = core.uvc_point_pairs(handle), core.uvc_edge_pairs(handle)
    pairs = Pairs(
        np.empty((points, 2), np.int32),
        np.empty(points, np.float32),
        np.empty((edges, 2), np.int32),
        np.empty((edges, 3), np.float32),
    )
    arrays = (pairs.points, pairs.sides, pairs.edges, pairs.directions)
    core.uvc_get_pairs(handle, *map(pointer, arrays))
    return pairs


class Elastic:
    """Faces and hinges of cloth alone, in the runtime."""

    def __init__(self, sections: Mapping[str, NDArray[Any]], vertices: int) -> None:
        """Read sections of cloth of so many vertices, as runtime/src/elastic.h lists them.

        Raises ValueError with the runtime's sentence if they do not fit together.
        """
        content = pack(sections)
        self._handle = read_outfit(self, content, "uvc_read_elastic", "uvc_free_elastic", vertices)

    def stable_step(self, mass: Floats, rest: Floats) -> float:
        """Longest stable step, s, of the solver for cloth of mass (N,) kg at rest (N, 3) m."""
        masses, points = (np.ascontiguousarray(each, np.float32) for each in (mass, rest))
        return float(library().uvc_stable_step(self._handle, pointer(masses), pointer(points)))

    def add_forces(
        self, positions: Floats, velocities: Floats, forces: Floats, wind: Floats | None = None
    ) -> None:
        """Add the forces, N, of all faces and hinges to forces (N, 3), in place.

        positions: (N, 3) m. velocities: (N, 3) m/s, relative to a frame of reference that moves at `wind`,
        (3,) m/s, through the air.
        """
        still = np.zeros(3, np.float32) if wind is None else np.ascontiguousarray(wind, np.float32)
        library().uvc_add_forces(self._handle, *map(pointer, (positions, velocities, still, forces)))
