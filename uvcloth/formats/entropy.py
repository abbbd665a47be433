"""Entropy coding of whole numbers that are mostly small: an adaptive arithmetic coder.

Each number is coded as decisions, which models predict from numbers coded before: runtime/src/entropy.cpp.
Here are the limits and the checksum. The code of five packs of `benchmarks/simulated` is 20 % smaller than
that of LZMA, and 24 % smaller than that of Zstandard at level 19, of the same numbers as planes of bytes.
"""

import zlib

import numpy as np

from uvcloth.player.library import library

MOST_DIGITS = 24
"""Binary digits of a number, without its sign."""

CHECKED = 4
"""Bytes of the checksum of the numbers."""

MOST_NUMBERS = 1 << 27
"""Limit for the numbers of an array: they take a gigabyte."""

MOST_PER_BYTE, LEAST_BYTES = 30_000, 256
"""Limit for the numbers in a byte of code (a likely decision takes 1/2,000 of a bit), and the bytes that are
added to the length of short code for this limit.
"""

AXES = 3
"""Numbers on the last axis that belong together: the coordinates of one wave."""

NO_MEMORY = -1
"""What the runtime returns where no memory is left; other negative numbers are wrong arguments."""


def encode(values: np.ndarray, stride: int) -> np.ndarray:
    """Encode whole numbers (T, K, C) to bytes (B,) uint8, of which the first four are a checksum.

    C is a multiple of AXES. Sizes are expected to change little along K, and along T from one number to the
    next and over the stride. Raises ValueError for numbers of more than MOST_DIGITS digits, or more than
    MOST_NUMBERS.
    """
    if values.size > MOST_NUMBERS:
        raise ValueError("points and frames are too many")
    if np.abs(values).max(initial=0) >= 1 << MOST_DIGITS:
        raise ValueError("points are too far away, or too fast")
    digits = np.frexp(np.abs(values).astype(np.float64))[1].astype(np.int64)
    # A number takes at most 2 * digits + 2 decisions; each writes four bytes at most.
    code = np.zeros(4 * int((2 * digits + 2).sum()) + 4, np.uint8)
    numbers = np.ascontiguousarray(values, np.int64)
    result = library().uvc_encode_numbers(
        numbers.ctypes.data, *values.shape, stride, code.ctypes.data, len(code)
    )
    return np.concatenate([_checksum(values), code[: _checked(result)]])


def decode(code: np.ndarray, shape: tuple[int, int, int], stride: int) -> np.ndarray:
    """Decode bytes of `encode` to whole numbers (T, K, C), int64.

    Raises ValueError if the bytes are damaged, or belong to another shape.
    """
    if np.prod(shape, dtype=np.float64) > min(MOST_PER_BYTE * (LEAST_BYTES + len(code)), MOST_NUMBERS):
        raise ValueError("code is too short for so many numbers")
    values = np.zeros(shape, np.int64)
    coded = np.ascontiguousarray(code[CHECKED:], np.uint8)
    _checked(library().uvc_decode_numbers(coded.ctypes.data, len(coded), values.ctypes.data, *shape, stride))
    if not np.array_equal(code[:CHECKED], _checksum(values)):
        raise ValueError("code is damaged or belongs to other numbers")
    return values


def _checksum(values: np.ndarray) -> np.ndarray:
    content = values.astype("<i8").tobytes()
    return np.frombuffer(zlib.crc32(content).to_bytes(CHECKED, "little"), np.uint8)


def _checked(result: int) -> int:
    """Bytes that the runtime wrote. Raises MemoryError or ValueError for its codes of failure."""
    if result == NO_MEMORY:
        raise MemoryError("no memory is left to code numbers")
    if result < 0:
        raise ValueError("numbers of this shape cannot be coded")
    return result
