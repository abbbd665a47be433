"""Limits to the size of garments, checked by what a file says of itself before it is read."""

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from uvcloth.errors import InputError

MOST_VERTICES = 200_000
"""Limit for the vertices of a garment: a rollout could not handle more."""

MOST_FACES = 2_000_000
"""Limit for the faces of a garment, far more than MOST_VERTICES need."""

HEAD = 1 << 16
"""Bytes at the beginning of a file in which it states its counts."""

STL_HEAD, STL_FACE = 84, 50
"""Bytes of a binary STL before its faces, and of each."""


def refuse_too_many(path: Path, vertices: int, faces: int = 0) -> None:
    """Raise InputError for a mesh of more than MOST_VERTICES or MOST_FACES."""
    if vertices > MOST_VERTICES:
        raise InputError(
            f"{path}: the garment has {vertices:,} vertices, at most {MOST_VERTICES:,} are supported: "
            "reduce the mesh first"
        )
    if faces > MOST_FACES:
        raise InputError(f"{path}: the garment has {faces:,} faces, at most {MOST_FACES:,} are supported")


def refuse_large_file(path: Path) -> None:
    """Raise InputError if a mesh file states more than MOST_VERTICES or MOST_FACES, in constant memory.

    PLY, OFF and binary STL state their counts; the vertices of an OBJ and of an STL in text are counted.
    Files that state nothing pass, and glTF, whose reader checks the counts of its document.
    """
    with suppress(OSError):  # The reader says why it cannot be read.
        if path.is_file():
            refuse_too_many(path, *_stated(path))


def _stated(path: Path) -> tuple[int, int]:
    """The vertices and faces that a file states, 0 where it does not."""
    with path.open("rb") as stream:
        head = stream.read(HEAD)
    match path.suffix.lower():
        case ".ply":
            stated = dict(re.findall(rb"^element (vertex|face) (\d{1,18})", head, re.MULTILINE))
            return int(stated.get(b"vertex", 0)), int(stated.get(b"face", 0))
        case ".off":
            counts = re.match(rb"\s*OFF(?:\s|#[^\n]*\n)+(\d{1,18})\s+(\d{1,18})\s", head)
            return (int(counts[1]), int(counts[2])) if counts else (0, 0)
        case ".stl":
            faces = int.from_bytes(head[STL_HEAD - 4 : STL_HEAD], "little")
            if path.stat().st_size == STL_HEAD + STL_FACE * faces:
                return 3 * faces, faces
            return _occurrences(path, b"vertex "), 0
        case ".obj":
            return _occurrences(path, b"\nv "), 0
    return 0, 0


def _occurrences(path: Path, word: bytes) -> int:
    """Number of times that a word is in a file."""
    return sum(chunk.count(word) for chunk in _overlapping(path, len(word) - 1))


def _overlapping(path: Path, shared: int) -> Iterator[bytes]:
    """A file in chunks, each after the last `shared` bytes of the one before."""
    last = b"\n"
    with path.open("rb") as stream:
        while chunk := stream.read(1 << 20):
            yield last + chunk
            last = (last + chunk)[-shared:]
