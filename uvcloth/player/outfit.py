"""Characters in baked outfits, in the runtime: joints in, vertices out, a frame at a time (uvcloth.h)."""

import ctypes
import weakref
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from uvcloth.player.cloth import GRAVITY
from uvcloth.player.handles import MESSAGE_ROOM, pointer, read_outfit
from uvcloth.player.library import library

Joints = NDArray[np.float64]


class Outfit:
    """A baked outfit, which any number of characters may wear.

    content: the bytes that it was read from. joints: J, the number of joints. cages: n, the vertices on which
    all cloth is solved. garments: vertices of each, the innermost first.
    """

    def __init__(self, content: bytes) -> None:
        """Read what was baked. Raises ValueError with the runtime's sentence if it is damaged."""
        self.content = content
        self.handle = read_outfit(self, content, "uvc_read", "uvc_free")
        core = library()
        self.joints: int = core.uvc_joints(self.handle)
        self.cages: int = core.uvc_cages(self.handle)
        count = core.uvc_garments(self.handle)
        self.garments = tuple(int(core.uvc_garment_vertices(self.handle, k)) for k in range(count))

    def cage_faces(self) -> NDArray[np.int32]:
        """Corners (m, 3) of the cages' faces: which of their n vertices."""
        corners = np.empty((library().uvc_cage_faces(self.handle), 3), np.int32)
        library().uvc_cage_corners(self.handle, pointer(corners))
        return corners

    def __reduce__(self) -> tuple[type[Self], tuple[bytes]]:
        """Pickle the bytes; the runtime reads them again."""
        return type(self), (self.content,)


class Cloth:
    """The cloth of one character."""

    def __init__(self, outfit: Outfit) -> None:
        """Make cloth that is nowhere before `start`."""
        self.outfit = outfit
        self._handle = ctypes.c_void_p(library().uvc_new(outfit.handle))
        weakref.finalize(self, library().uvc_drop, self._handle)

    def start(self, joints: Joints) -> None:
        """Let cloth come to rest on the body in its first pose, and show the garments there.

        joints: (J, 3, 4) transforms of the joints from the rest pose, without scale, m, z up.
        Raises ValueError with the runtime's sentence for joints that are not finite, or not as many.
        """
        self._do(library().uvc_start, joints)

    def step(self, joints: Joints, seconds: float) -> None:
        """Move the cloth on to the pose of joints (J, 3, 4), so many seconds later.

        The first step after `start` is to the pose of the first frame. Where the root jumps, by more than
        10 m/s, the cloth comes along as it hangs.
        Raises ValueError with the runtime's sentence for joints that are not finite, or not as many, a body
        that is faster than 40 m/s past the cloth, and cloth that flies apart; it stays as it was then.
        """
        self._do(library().uvc_step, joints, ctypes.c_double(seconds))

    def pull(self, points: NDArray[np.float64] | None, rate: float) -> None:
        """Pull the cages to points (n, 3) m in the world, by springs of a frequency, 1/s, in all later steps.

        `start` begins there then. Rate 0 ends it, and needs no points.
        """
        given = np.zeros((self.outfit.cages, 3)) if points is None else points
        places = np.ascontiguousarray(given, np.float64)
        assert places.shape == (self.outfit.cages, 3)
        library().uvc_pull(self._handle, pointer(places), ctypes.c_double(rate))

    def set_world(self, wind: Sequence[float] = (0.0, 0.0, 0.0), gravity: Sequence[float] = GRAVITY) -> None:
        """Set wind (3,) m/s and gravity (3,) m/s2, in the world of the joints, for all later steps.

        The body does not shield cloth from wind. Raises ValueError with the runtime's sentence for more than
        100 of either.
        """
        both = [np.array(each, np.float64) for each in (wind, gravity)]
        assert all(each.shape == (3,) for each in both)
        self._call(library().uvc_set_world, *map(pointer, both))

    def set_fabric(self, garment: int, density: float = 1.0, stretch: float = 1.0, bend: float = 1.0) -> None:
        """Change the fabric of a garment, by factors on what was baked, from 0.01 to 100.

        density: of its weight per area. stretch, bend: of its stiffness in the plane and in bending. Frames
        get as many substeps as the new fabric needs. Raises ValueError with the runtime's sentence for other
        factors.
        """
        factors = (ctypes.c_double(each) for each in (density, stretch, bend))
        self._call(library().uvc_set_fabric, range(len(self.outfit.garments))[garment], *factors)

    def save(self) -> NDArray[np.uint8]:
        """Bytes of all that the cloth remembers."""
        content = np.empty(library().uvc_saved_size(self._handle), np.uint8)
        library().uvc_save(self._handle, pointer(content))
        return content

    def restore(self, content: NDArray[np.uint8]) -> None:
        """Go on from what `save` returned of cloth in the same outfit. Raises ValueError for other bytes."""
        if not library().uvc_restore(self._handle, pointer(content), ctypes.c_size_t(len(content))):
            raise ValueError("the bytes are not those of cloth in this outfit")

    def cages(self) -> NDArray[np.float64]:
        """Vertices (n, 3) m of all cages, in the world of the joints."""
        places = np.empty((self.outfit.cages, 3))
        library().uvc_cage_vertices(self._handle, pointer(places))
        return places

    def vertices(self, garment: int) -> NDArray[np.float64]:
        """Vertices (V, 3) m of a garment, in the world of the joints."""
        index = range(len(self.outfit.garments))[garment]
        places = np.empty((self.outfit.garments[index], 3))
        library().uvc_vertices(self._handle, index, pointer(places))
        return places

    def _do(self, function: "ctypes._NamedFuncPointer", joints: Joints, *more: ctypes.c_double) -> None:
        rows = np.ascontiguousarray(joints, np.float64)
        if rows.shape != (self.outfit.joints, 3, 4):
            raise ValueError(
                f"transforms of {self.outfit.joints} joints (J, 3, 4) were expected, not {rows.shape}"
            )
        self._call(function, pointer(rows), *more)

    def _call(self, function: "ctypes._NamedFuncPointer", *arguments: Any) -> None:
        message = ctypes.create_string_buffer(MESSAGE_ROOM)
        if not function(self._handle, *arguments, message, ctypes.c_size_t(MESSAGE_ROOM)):
            raise ValueError(message.value.decode())
