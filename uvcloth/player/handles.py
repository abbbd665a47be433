"""Objects of the runtime, as Python holds them: read from packed sections, freed with their owner."""

import ctypes
import weakref
from typing import Any

from numpy.typing import NDArray

from uvcloth.player.library import library

MESSAGE_ROOM = 512
"""Bytes of the longest sentence on what is wrong with an outfit."""


def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    """Address of a contiguous array's numbers."""
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


def read_outfit(owner: object, content: bytes, read: str, free: str, *sizes: int) -> ctypes.c_void_p:
    """Read packed sections by a function of the runtime; what it made is freed with its owner.

    sizes: further arguments of that function.

    Raises ValueError with the runtime's sentence if the sections are damaged or do not fit together.
    """
    function = getattr(library(), read)
    function.restype = ctypes.c_void_p
    message = ctypes.create_string_buffer(MESSAGE_ROOM)
    size, room = ctypes.c_size_t(len(content)), ctypes.c_size_t(MESSAGE_ROOM)
    handle = function(content, size, *sizes, message, room)
    if not handle:
        raise ValueError(message.value.decode())
    weakref.finalize(owner, getattr(library(), free), ctypes.c_void_p(handle))
    return ctypes.c_void_p(handle)
