"""Damage to MATLAB files: numbers in their tags and headers, also of arrays that are compressed."""

import struct
import zlib
from pathlib import Path
from random import Random

from tests.fuzz.byte_mutators import WORDS
from tests.fuzz.target import Mutator

HEADER = 128
MATRIX, COMPRESSED = 14, 15
TYPES = (0, 1, 2, 3, 4, 5, 6, 7, 9, 14, 15, 16, 17, 255)


def put_in_array(path: Path, random: Random) -> str:
    """A word of an array, often a size, a type or a count, replaced; the array is compressed afterwards."""
    content = path.read_bytes()
    arrays = _arrays(content)
    if not arrays:
        return "no arrays"
    chosen = random.randrange(len(arrays))
    array = bytearray(arrays[chosen])
    place = random.randrange(0, max(len(array) // 4, 1)) * 4
    word = random.choice((*TYPES, *(each % 2**32 for each in WORDS)))
    array[place : place + 4] = struct.pack("<I", word)
    arrays[chosen] = bytes(array)
    path.write_bytes(content[:HEADER] + b"".join(map(_compressed, arrays)))
    return f"{word} at {place} of array {chosen}"


def inflate(path: Path, random: Random) -> str:
    """A few KB that unpack to megabytes."""
    content = path.read_bytes()
    size = random.choice((2**21, 2**23))
    array = struct.pack("<II", random.choice((MATRIX, 1)), size) + bytes(size)
    path.write_bytes(content[:HEADER] + _compressed(array) + content[HEADER:])
    return f"{size} bytes of zeros compressed"


def nest(path: Path, random: Random) -> str:
    """Structs within one another."""
    depth = random.choice((10, 25, 1000, 10_000))
    array = b""
    for _ in range(depth):
        flags = struct.pack("<IIII", 6, 8, 2, 0) + struct.pack("<IIII", 5, 8, 1, 1)
        names = struct.pack("<III", 1 << 16 | 1, 97, 4 << 16 | 5) + struct.pack("<III", 2, 1 << 16 | 1, 97)
        body = flags + names + array
        array = struct.pack("<II", MATRIX, len(body)) + body
        if len(array) > 2**21:
            break
    path.write_bytes(path.read_bytes()[:HEADER] + array)
    return f"{depth} structs within one another"


def _arrays(content: bytes) -> list[bytes]:
    """The arrays of a good file, unpacked, with their tags; none of a damaged one."""
    place, found = HEADER, []
    try:
        while place < len(content):
            kind, size = struct.unpack_from("<II", content, place)
            whole = content[place : place + 8 + size]
            found.append(zlib.decompress(whole[8:]) if kind == COMPRESSED else whole)
            place += 8 + size
    except (struct.error, zlib.error):
        return []
    return found


def _compressed(array: bytes) -> bytes:
    packed = zlib.compress(array)
    return struct.pack("<II", COMPRESSED, len(packed)) + packed


MATLAB: tuple[Mutator, ...] = (put_in_array, put_in_array, put_in_array, put_in_array, inflate, nest)
