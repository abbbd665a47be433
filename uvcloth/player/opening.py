"""Opened colliders by the runtime: parts that a pose presses into each other are pushed apart."""

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from uvcloth.player.handles import pointer, read_outfit
from uvcloth.player.library import library
from uvcloth.player.sections import pack

Floats = NDArray[np.float32]
Sections = Mapping[str, NDArray[Any]]

TILE = 8
"""Points in a row that the runtime skips together, so they should lie close to each other."""


class Opening:
    """Pressed parts of a collider of C vertices, in the runtime (uvcloth.h).

    sections: their arrays by name. A side is one part of a pair against the other; sides 2k and 2k + 1 are
    pair k. "opening.starts" (S + 1), first point of each side. "opening.points" (K), vertex of each point;
    ".want" (K) m, distance that it keeps from the other part. ".spacing" (1) m, least between points.
    ".slope" (1), change of a push along the skin, metres for each metre. ".allowed" (S, C) m, longest push of
    each vertex.

    "skin.rest" (V, 3) m, the first vertices of the collider at rest. ".faces" (F, 3), the skin of all parts.
    ".clear" (C) m, distance along the skin within which other vertices are no points beside one that is, -1
    for those; ".reach" (1) m, how much farther a push of a point reaches.

    ".tips" (T), the tips of the caps. ".rim_starts" (T + 1), first row of each tip in ".rims" (E), the
    vertices around it.
    """

    def __init__(self, sections: Sections) -> None:
        """Read sections. Raises ValueError with the runtime's sentence if they do not fit together."""
        self.sections = dict(sections)
        self.vertices = len(sections["opening.clear"])
        self._handle = read_outfit(
            self, pack(self.sections), "uvc_read_opening", "uvc_free_opening", self.vertices
        )

    def __reduce__(self) -> tuple[type[Self], tuple[Sections]]:
        """Pickle the sections; the runtime reads them again."""
        return type(self), (self.sections,)

    def open_frames(self, frames: Floats) -> None:
        """Push the parts of collider vertices (F, C, 3) m apart, in place, each frame by itself."""
        assert frames.dtype == np.float32
        assert frames.shape[1:] == (self.vertices, 3)
        library().uvc_open_frames(self._handle, pointer(frames), len(frames))

    def distances(self, corners: Floats) -> Floats:
        """Signed distances (K,) m of the points of collider vertices (C, 3) m to the other parts, 1e9 for
        none."""
        assert corners.shape == (self.vertices, 3)
        corners = np.ascontiguousarray(corners, np.float32)
        signed = np.empty(len(self.sections["opening.points"]), np.float32)
        library().uvc_opening_distances(self._handle, pointer(corners), pointer(signed))
        return signed


def in_tiles(points: Floats) -> NDArray[np.int64]:
    """Order (N,) of points (N, 3) m in which every TILE of them lie close together.

    Parts with more points are halved across their longest side, all parts at once, until none has.
    """
    order, starts = np.arange(len(points)), np.zeros(min(len(points), 1), np.int64)
    while True:
        sizes = np.diff(starts, append=len(points))
        large = sizes > TILE
        if not large.any():
            return order
        here = points[order]
        sides = np.maximum.reduceat(here, starts) - np.minimum.reduceat(here, starts)
        part = np.repeat(np.arange(len(starts)), sizes)
        along = np.where(large[part], here[np.arange(len(here)), sides.argmax(1)[part]], 0.0)
        order = order[np.lexsort((along, part))]
        halves = TILE * np.maximum(1, np.rint(0.5 * sizes[large] / TILE)).astype(np.int64)
        starts = np.sort(np.concatenate([starts, starts[large] + halves]))
