"""MATLAB files (level 5): numbers, texts and structs, read without trust in their headers.

The format is that of "MAT-File Format" by MathWorks. `scipy.io.loadmat` allocates memory by a file's headers,
and a damaged tag crashes the process.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.errors import InputError
from uvcloth.files.reading import read_content

MOST_BYTES = 4 * 2**20
"""Limit for the bytes of a file, and for its unpacked contents."""

MOST_DEPTH = 20
"""Limit for the depth of nested structs."""

NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Stored types of numbers, by type code."""

TEXTS = {1: "utf-8", 2: "utf-8", 16: "utf-8", 4: "utf-16", 17: "utf-16", 18: "utf-32"}
"""Encodings of stored texts, by type code."""

MATRIX, COMPRESSED = 14, 15
"""Elements that hold an array, and one that is compressed."""

STRUCT, TEXT, NUMERIC, OPAQUE, COMPLEX = 2, 4, range(6, 16), 17, 0x800
"""Classes of arrays, and the flag of complex numbers."""

HEADER = 128
ORDERS = {b"IM": "<", b"MI": ">"}

Value = np.ndarray | str | dict[str, Any] | None


def read_matlab(path: Path) -> dict[str, Value]:
    """Read the variables of a file: numbers as arrays without axes of length one, texts of a single row,
    structs as dictionaries; everything else is None.

    Raises InputError naming the file if it is missing, damaged, of another version, or larger than
    MOST_BYTES.
    """
    content = read_content(path)
    if len(content) > MOST_BYTES:
        raise InputError(f"{path}: has {len(content)} bytes, expected {MOST_BYTES} at most")
    order = ORDERS.get(content[HEADER - 2 : HEADER])
    if order is None:
        raise InputError(f"{path}: not a MATLAB file of level 5 (as MATLAB saves with -v6 or -v7)")
    try:
        items = [_array(part, order, 0) for part in _arrays(memoryview(content)[HEADER:], order)]
        return _unique(item for item in items if item[0])
    except (ValueError, OverflowError, IndexError, zlib.error, struct.error) as error:
        raise InputError(f"{path}: not a readable MATLAB file ({str(error)[:100]})") from error


def _arrays(content: memoryview, order: str) -> Iterator[memoryview]:
    """Contents of the arrays of a file, unpacked. Raises ValueError if they have more than MOST_BYTES."""
    room = MOST_BYTES
    for stored in _elements(content, order):
        element = stored
        if stored[0] == COMPRESSED:
            stream = zlib.decompressobj()
            unpacked = stream.decompress(stored[1], room + 1)
            room -= len(unpacked)
            if not stream.eof or room < 0:
                raise ValueError("an array is incomplete, or unpacks to too much")
            element = _next(_elements(memoryview(unpacked), order))
        if element[0] == MATRIX:
            yield element[1]


def _elements(content: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Consecutive elements: the type code and the content of each."""
    place = 0
    while place < len(content):
        kind, size = struct.unpack_from(f"{order}II", content, place)
        start, after = place + 8, place + 8 + size
        if kind >> 16:
            # The content of a small element lies in its tag.
            kind, size = kind & 0xFFFF, kind >> 16
            start, after = place + 4, place + 8
        end = start + size
        if end > len(content) or (start < place + 8 and size > 4):
            raise ValueError("an element reaches beyond its container")
        yield kind, content[start:end]
        place = after if kind == COMPRESSED else after + -after % 8


def _next(elements: Iterator[tuple[int, memoryview]]) -> tuple[int, memoryview]:
    """The next element. Raises ValueError if there is none."""
    for element in elements:
        return element
    raise ValueError("an array that lacks a part")


def _array(content: memoryview, order: str, depth: int) -> tuple[str, Value]:
    """Name and value of an array; "" where it has no name."""
    if depth > MOST_DEPTH:
        raise ValueError(f"structs within one another, deeper than {MOST_DEPTH}")
    elements = _elements(content, order)
    first = next(elements, None)
    if first is None:
        return "", np.zeros(0)  # An empty array may be written without any element.
    flags = int(_numbers(first, order)[0])
    kind = flags & 0xFF
    if kind == OPAQUE:
        return "", None
    shape = [int(size) for size in _numbers(_next(elements), order)]
    name = bytes(_next(elements)[1]).decode("ascii")
    if len(shape) < 2 or len(shape) > 8 or min(shape) < 0:
        raise ValueError(f"an array of the shape {shape[:8]}")
    if kind == STRUCT and math.prod(shape) == 1:
        return name, _struct(elements, order, depth)
    if kind == TEXT and (shape[0] == 1 or not math.prod(shape)):
        return name, _text(_next(elements), order)
    if kind in NUMERIC and not flags & COMPLEX:
        values = _numbers(_next(elements), order)
        return name, values.reshape(shape, order="F").squeeze() if math.prod(shape) else np.zeros(0)
    return name, None


def _struct(elements: Iterator[tuple[int, memoryview]], order: str, depth: int) -> dict[str, Value]:
    """The fields of a struct."""
    width = int(_numbers(_next(elements), order)[0])
    letters = bytes(_next(elements)[1])
    if width < 1 or len(letters) % width:
        raise ValueError(f"names of {width} letters, {len(letters)} in all")
    starts = range(0, len(letters), width)
    names = [letters[start : start + width].partition(b"\0")[0].decode("ascii") for start in starts]
    values = [_array(content, order, depth + 1)[1] for kind, content in elements if kind == MATRIX]
    return _unique(zip(names, values, strict=True))


def _unique(items: Any) -> dict[str, Value]:
    """Values by name. Raises ValueError for an invalid name of a variable, or one that occurs twice."""
    values: dict[str, Value] = {}
    for name, value in items:
        if not name.isidentifier() or name in values:
            raise ValueError(f"the name {name[:40]!r} is not a variable's name, or occurs twice")
        values[name] = value
    return values


def _numbers(element: tuple[int, memoryview], order: str) -> np.ndarray:
    """Numbers (N,) of an element."""
    kind, content = element
    if kind not in NUMBERS:
        raise ValueError(f"numbers of the type {kind}")
    stored = np.dtype(order + NUMBERS[kind])
    return np.frombuffer(content, stored).astype(stored.newbyteorder("="), copy=False)


def _text(element: tuple[int, memoryview], order: str) -> str:
    kind, content = element
    if kind not in TEXTS:
        raise ValueError(f"a text of the type {kind}")
    ends = "" if TEXTS[kind] == "utf-8" else {"<": "-le", ">": "-be"}[order]
    return bytes(content).decode(TEXTS[kind] + ends)
