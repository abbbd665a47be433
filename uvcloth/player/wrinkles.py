"""Wrinkles by the runtime: garments on finer meshes, displaced by a network (uvcloth.h)."""

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvcloth.player.handles import pointer, read_outfit
from uvcloth.player.library import library
from uvcloth.player.sections import pack

Floats = NDArray[np.float32]


class WrinkleMaker:
    """A network and the garments that it makes wrinkles on, frame after frame.

    vertices: n, of the finer meshes of all garments.
    """

    def __init__(
        self, sections: Mapping[str, NDArray[Any]], steps: Mapping[str, float] | None = None
    ) -> None:
        """Read sections by their names, as runtime/src/wrinkles.h lists them, rounded to steps.

        Raises ValueError with the runtime's sentence if they do not fit together.
        """
        self._points = len(sections["points.rest"])
        self._handle = read_outfit(self, pack(sections, steps), "uvc_read_wrinkles", "uvc_free_wrinkles")
        self.vertices: int = library().uvc_wrinkled_vertices(self._handle)
        self._memory = np.empty(library().uvc_wrinkle_memory(self._handle), np.uint8)
        self.begin()

    def begin(self) -> None:
        """Forget the frames before."""
        library().uvc_begin_wrinkles(self._handle, pointer(self._memory))

    def wrinkle(self, points: Floats, skin: Floats, seconds: float) -> Floats:
        """Vertices (n, 3) m of all garments, at points (P, 3) m, in the next frame, so many seconds later.

        skin: (V, 3) m of the body. All frames are around one origin.
        """
        places, body = (np.ascontiguousarray(each, np.float32) for each in (points, skin))
        assert places.shape == (self._points, 3)
        made = np.empty((self.vertices, 3), np.float32)
        library().uvc_wrinkle(
            self._handle,
            pointer(self._memory),
            pointer(places),
            pointer(body),
            ctypes.c_double(seconds),
            pointer(made),
        )
        return made
