"""Named arrays as one run of bytes, the file of a baked outfit: runtime/src/sections.cpp reads it.

A header, an entry for each array, then the code of their numbers (runtime/src/section_coder.cpp). All is
little-endian.
"""

import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvcloth.player.handles import pointer
from uvcloth.player.library import library

MAGIC, VERSION = b"UVCLOTH\0", 2
MOST_NAME = 31
"""Bytes of a name; a zero follows."""

MOST_NUMBERS = 1 << 24
"""Limit for the numbers of an array."""

MOST_CODE = 32
"""Bytes that the code of a number takes at most, and those that it begins and ends with."""

STORED = b"\x04"
"""First byte of a code that is the numbers as they are."""

_FLOATS, _INTEGERS, _STEPS = 0, 1, 2
_HEADER, _CHECKED, _ENTRY = struct.Struct("<8sII"), struct.Struct("<II"), struct.Struct("<32s5If")


def row_starts(counts: Sequence[int] | NDArray[Any]) -> NDArray[np.int64]:
    """First element of each row of a jagged array, whose rows have so many, and the end of the last."""
    return np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])


def pack(
    arrays: Mapping[str, NDArray[Any]], steps: Mapping[str, float] | None = None, *, compressed: bool = False
) -> bytes:
    """Write arrays (R,) or (R, C) of real numbers to bytes, floats as float32 and all others as int32.

    steps: by the names of arrays of floats, of which their numbers become multiples. compressed: for a file,
    with entropy-coded numbers: a quarter of the size for a dress, and slower to write and read. Raises
    ValueError for a name, a shape, or a number that the format has no place for.
    """
    entries, data = bytearray(), bytearray()
    begin = _HEADER.size + _CHECKED.size + _ENTRY.size * len(arrays)
    for name, array in arrays.items():
        step = 0.0 if steps is None else steps.get(name, 0.0)
        kind, numbers = _numbers(name, array if step == 0.0 else np.rint(array / step).astype(np.int64))
        kind = _STEPS if step else kind
        rows, columns = numbers.shape if numbers.ndim == 2 else (len(numbers), 1)
        code = _encoded(numbers, rows, columns) if compressed else _stored(numbers)
        entries += _ENTRY.pack(_name(name), kind, rows, columns, begin + len(data), len(code), step)
        data += code
    size = begin + len(data)
    if size >= 1 << 32:
        raise ValueError(f"sections take {size} bytes, more than the format counts")
    checked = _CHECKED.pack(size, len(arrays)) + entries + data
    return _HEADER.pack(MAGIC, VERSION, zlib.adler32(checked)) + checked


def unpack(content: bytes) -> tuple[dict[str, NDArray[Any]], dict[str, float]]:
    """Arrays, of one or more columns, and steps, of bytes that the runtime has read, as `pack` takes them."""
    arrays: dict[str, NDArray[Any]] = {}
    steps: dict[str, float] = {}
    first = _HEADER.size + _CHECKED.size
    _, count = _CHECKED.unpack_from(content, _HEADER.size)
    for padded, kind, rows, columns, begin, size, step in _ENTRY.iter_unpack(
        content[first : first + count * _ENTRY.size]
    ):
        name, code = padded.rstrip(b"\0").decode(), np.frombuffer(content, np.uint8, size, begin)
        numbers = np.zeros(rows * columns, np.int32)
        if numbers.size:
            library().uvc_decode_section(pointer(code), len(code), pointer(numbers), rows, columns)
        if kind == _STEPS:
            steps[name] = step
        values = numbers.view(np.float32) if kind == _FLOATS else numbers * (step if kind == _STEPS else 1)
        arrays[name] = values.reshape(rows, columns) if columns > 1 else values
    return arrays, steps


def _name(name: str) -> bytes:
    encoded = name.encode()
    if not encoded or len(encoded) > MOST_NAME or b"\0" in encoded:
        raise ValueError(f"section {name!r} needs a name of 1 to {MOST_NAME} bytes")
    return encoded


def _stored(numbers: NDArray[Any]) -> bytes:
    """Numbers of four bytes as they are."""
    return STORED + numbers.tobytes() if numbers.size else b""


def _encoded(numbers: NDArray[Any], rows: int, columns: int) -> bytes:
    """The code of numbers of four bytes."""
    numbers = np.ascontiguousarray(numbers)
    code = np.empty(MOST_CODE * (numbers.size + 1), np.uint8)
    size = library().uvc_encode_section(pointer(numbers), rows, columns, pointer(code), len(code))
    return code[:size].tobytes()


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
