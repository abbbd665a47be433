"""Clearing by the runtime: fine meshes are moved off the skin and over it."""

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from uvcloth.player.handles import pointer, read_outfit
from uvcloth.player.library import library
from uvcloth.player.sections import pack

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class ClearingMemory:
    """Memory of a clearing from one frame to the next, as bytes of the runtime."""

    content: NDArray[np.uint8]

    @property
    def frame(self) -> int:
        """Number of earlier frames."""
        return int(self.content[:4].view(np.int32)[0])


class Clearing:
    """Fine meshes of an outfit and the body that they are kept off, in the runtime (uvcloth.h)."""

    def __init__(self, sections: Mapping[str, NDArray[Any]]) -> None:
        """Read sections by their names, as runtime/src/clearing.h lists them.

        Raises ValueError with the runtime's sentence if they do not fit together.
        """
        self.sections = dict(sections)
        self._handle = read_outfit(self, pack(self.sections), "uvc_read_clearing", "uvc_free_clearing")

    def __reduce__(self) -> tuple[type[Self], tuple[Mapping[str, NDArray[Any]]]]:
        """Pickle the sections; the runtime reads them again."""
        return type(self), (self.sections,)

    def begin(self) -> ClearingMemory:
        """Memory before the first frame, from which nothing is known."""
        content = np.empty(library().uvc_clearing_memory(self._handle), np.uint8)
        library().uvc_begin_clearing(self._handle, pointer(content))
        return ClearingMemory(content)

    def clear(
        self, before: ClearingMemory, cloth: Floats, collider: Floats, clearance: float, reach: float
    ) -> tuple[ClearingMemory, Floats]:
        """Move cloth (N, 3) m to at least a clearance, m, off a collider (C, 3) m around the same origin.

        before: of the frame before. reach: metres within which the skin is searched; deeper vertices stay.
        Returns the memory for the next frame, and the cloth.
        """
        content, cleared = before.content.copy(), np.array(cloth, np.float32, order="C")
        points = np.ascontiguousarray(collider, np.float32)
        library().uvc_clear(
            self._handle,
            pointer(content),
            pointer(cleared),
            pointer(points),
            ctypes.c_float(clearance),
            ctypes.c_float(reach),
        )
        return ClearingMemory(content), cleared

    def cover(self, cloth: Floats, skin: Floats) -> None:
        """Move cloth (N, 3) m over the skin (V, 3) m that it covers at rest and that shows, in place."""
        points = np.ascontiguousarray(skin, np.float32)
        library().uvc_cover(self._handle, pointer(cloth), pointer(points))

    def lift(self, cloth: Floats, clearance: float, turns: int) -> None:
        """Move outer garments, of cloth (N, 3) m, to a clearance, m, off those beneath them, in place.

        turns: times that each garment is moved; after all but the last one its neighbours follow.
        """
        library().uvc_lift(self._handle, pointer(cloth), ctypes.c_float(clearance), ctypes.c_int(turns))
