"""PC2 point caches, which the modifier Mesh Cache plays."""

import os
import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_HEADER = struct.Struct("<12siiffi")
"""Signature, version, points, first frame, frames from sample to sample, samples."""


class Pc2File:
    """A point cache that is being written: beside its place, where it goes when all frames are there."""

    def __init__(self, path: Path, points: int, frames: int) -> None:
        """Open it for so many frames of so many points. Raises OSError."""
        self.path, self._points, self._frames = path, points, frames
        path.parent.mkdir(parents=True, exist_ok=True)
        self._partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
        self._stream = self._partial.open("wb")
        self._stream.write(_HEADER.pack(b"POINTCACHE2\0", 1, points, 0.0, 1.0, frames))

    def write(self, vertices: NDArray) -> None:
        """Append a frame, (points, 3)."""
        assert vertices.shape == (self._points, 3)
        self._stream.write(np.ascontiguousarray(vertices, "<f4").data)

    def finish(self) -> None:
        """Put the file in its place."""
        self._stream.close()
        size = _HEADER.size + 12 * self._points * self._frames
        assert self._partial.stat().st_size == size
        self._partial.replace(self.path)

    def discard(self) -> None:
        """Leave nothing."""
        with suppress(OSError):
            # What is still to be written does not fit on a full disk either.
            self._stream.close()
        self._partial.unlink(missing_ok=True)
