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
    return make_handle(owner, read, free, content, ctypes.c_size_t(len(content)), *sizes)


def make_handle(owner: object, make: str, free: str, *arguments: Any) -> ctypes.c_void_p:
    """Make an object by a function of the runtime with some arguments; it is freed with its owner.

    Raises ValueError with the runtime's sentence if the arguments do not fit together.
    """
    function = getattr(library(), make)
    function.restype = ctypes.c_void_p
    message = ctypes.create_string_buffer(MESSAGE_ROOM)
    handle = function(*arguments, message, ctypes.c_size_t(MESSAGE_ROOM))
    if not handle:
        raise ValueError(message.value.decode())
    weakref.finalize(owner, getattr(library(), free), ctypes.c_void_p(handle))
    return ctypes.c_void_p(handle)
