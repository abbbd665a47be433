"""Named arrays as one run of bytes, the file of a baked outfit: runtime/src/sections.cpp reads it.

A header, an entry for each array, then their numbers. All is little-endian; every array begins at a multiple
of four bytes.
"""

import struct
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC, VERSION = b"UVCLOTH\0", 1
MOST_NAME = 31
"""Bytes of a name; a zero follows."""

MOST_NUMBERS = 1 << 24
"""Limit for the numbers of an array."""

_FLOATS, _INTEGERS = 0, 1
_HEADER, _CHECKED, _ENTRY = struct.Struct("<8sII"), struct.Struct("<II"), struct.Struct("<32s4I")


def pack(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Write arrays (R,) or (R, C) of real numbers to bytes, floats as float32 and all others as int32.

    Raises ValueError for a name, a shape, or a number that the format has no place for.
    """
    entries, data = bytearray(), bytearray()
    begin = _HEADER.size + _CHECKED.size + _ENTRY.size * len(arrays)
    for name, array in arrays.items():
        kind, numbers = _numbers(name, array)
        rows, columns = numbers.shape if numbers.ndim == 2 else (len(numbers), 1)
        entries += _ENTRY.pack(_name(name), kind, rows, columns, begin + len(data))
        data += numbers.tobytes()
    size = begin + len(data)
    if size >= 1 << 32:
        raise ValueError(f"sections take {size} bytes, more than the format counts")
    checked = _CHECKED.pack(size, len(arrays)) + entries + data
    return _HEADER.pack(MAGIC, VERSION, zlib.adler32(checked)) + checked


def _name(name: str) -> bytes:
    encoded = name.encode()
    if not encoded or len(encoded) > MOST_NAME or b"\0" in encoded:
        raise ValueError(f"section {name!r} needs a name of 1 to {MOST_NAME} bytes")
    return encoded


def _numbers(name: str, array: NDArray[Any]) -> tuple[int, NDArray[Any]]:
    """Kind of the numbers, and the numbers as the format stores them."""
    if array.ndim not in (1, 2) or array.size > MOST_NUMBERS:
        raise ValueError(f"section {name} is of shape {array.shape}: no rows, or too many")
    if np.issubdtype(array.dtype, np.floating):
        with np.errstate(over="ignore"):
            floats = array.astype("<f4")
        if not np.isfinite(floats).all():
            raise ValueError(f"section {name} has numbers that are not finite")
        return _FLOATS, floats
    if not np.issubdtype(array.dtype, np.integer) and array.dtype != np.bool_:
        raise ValueError(f"section {name} has numbers of type {array.dtype}")
    limits = np.iinfo(np.int32)
    if array.min(initial=0) < limits.min or array.max(initial=0) > limits.max:
        raise ValueError(f"section {name} has numbers of more than 32 bits")
    return _INTEGERS, array.astype("<i4")
