"""Read and write npz files: written whole or not at all, read without pickle and within a limit of size.

Nothing that a file claims is believed: an array's header has to agree with the size of its member before
memory is taken, and an archive that unpacks to far more than it has on disk is refused.
"""

import math
import re
import struct
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_write
from uvcloth.files.reading import require_file

FREE_BYTES = 256 * 2**20
"""Bytes to which any archive may unpack."""

MOST_RATIO = 100
"""Bytes to which an archive may unpack beyond that, for every byte that it has on disk."""

MOST_ROWS = 1_000_000
"""Greatest size of an axis of an array without values, which takes no space in a file."""

TYPES = re.compile(r"(?P<order>[<>|=]?)(?P<kind>[biufU])(?P<size>[1-9]\d{0,6})|(?P<flag>\|?\?)")
SIZES = {"b": (1,), "i": (1, 2, 4, 8), "u": (1, 2, 4, 8), "f": (2, 4, 8)}
"""Bytes of the numbers that are read, by kind; texts (U) may have any length."""

SHAPE = r"\(\s*+(?:\d{1,18}+L?(?:\s*+,\s*+\d{1,18}+L?){0,31}+\s*+,?)?\s*+\)"
ENTRY = rf"\s*+'(descr|fortran_order|shape)'\s*+:\s*+('[^']*+'|True|False|{SHAPE})\s*+"
HEADER = re.compile(rf"\{{{ENTRY},{ENTRY},{ENTRY},?\s*+\}}\s*+")
"""A header as numpy writes it. Nothing is tried twice, so that time does not grow with damage."""

MAGIC = b"\x93NUMPY"
MOST_HEADER = 10_000
CHUNK = 1 << 20


@dataclass(frozen=True)
class Header:
    """Header of an array: its type, its shape, whether its first axis is the fastest, and how
    many bytes the header has itself."""

    dtype: np.dtype
    shape: tuple[int, ...]
    fortran: bool
    size: int


def save_arrays(path: Path, arrays: Mapping[str, np.ndarray], compressed: bool = True) -> None:
    """Write arrays to an npz. Raises InputError if it cannot be written or the disk is full."""
    save = np.savez_compressed if compressed else np.savez
    with atomic_write(path) as partial, partial.open("wb") as stream:
        save(stream, allow_pickle=False, **arrays)


def smallest_indices(values: np.ndarray) -> np.ndarray:
    """Indices, none below zero, in the smallest type that holds them."""
    return values.astype(np.min_scalar_type(values.max(initial=0)))


def load_arrays(
    path: Path, format: str, expected: str, names: Sequence[str] = (), only: bool = False
) -> dict[str, np.ndarray]:
    """Read every array of an npz whose "format" entry equals `format`, as `read_arrays` does.

    expected: says in words what the file should be. names: arrays that it must hold. only: read no others.
    Raises InputError with the path if it is missing, damaged, not an npz, another format, or lacks an array.
    """
    data = read_arrays(path, expected, ("format", *names) if only else None)
    stored = str(data.get("format", "nothing"))
    if stored != format:
        named = stored if stored.isprintable() and len(stored) < 100 else "of another kind"
        raise InputError(f"{path}: expected {expected} (format {format}), found format {named}")
    missing = [name for name in names if name not in data]
    if missing:
        raise InputError(f"{path}: lacks the array {', '.join(missing)}, expected {expected}")
    return data


def read_arrays(path: Path, expected: str, names: Sequence[str] | None = None) -> dict[str, np.ndarray]:
    """Read arrays of any npz, those of some names that it has, or all, in the machine's byte order.

    Arrays hold whole or floating-point numbers, truth values or texts; nothing is unpickled.
    expected: says in words what the file should be. Raises InputError with the path if it is missing,
    damaged or not an npz, and naming an array of those that are read if it is pickled, of another type, not
    as large as its header says, or takes the file beyond FREE_BYTES and MOST_RATIO.
    """
    with _opened(path, expected) as archive:
        members = [m for m in archive.infolist() if names is None or _name(m) in names]
        _require_single(members)
        _require_moderate(members, path.stat().st_size)
        return {_name(member): _read(archive, member) for member in members}


def list_arrays(path: Path, expected: str) -> tuple[str, ...]:
    """Names of the arrays of an npz. Raises InputError as `read_arrays` does."""
    with _opened(path, expected) as archive:
        return tuple(_name(member) for member in archive.infolist())


@contextmanager
def _opened(path: Path, expected: str) -> Iterator[zipfile.ZipFile]:
    require_file(path)
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    # Between them, zipfile and zlib raise all of these for damaged bytes.
    except (
        *(OSError, ValueError, EOFError, RuntimeError, OverflowError, IndexError),
        *(zipfile.BadZipFile, zlib.error, struct.error),
    ) as error:
        raise InputError(f"{path}: not a readable npz, expected {expected}") from error


def _name(member: zipfile.ZipInfo) -> str:
    return member.filename.removesuffix(".npy")


def _require_single(members: Sequence[zipfile.ZipInfo]) -> None:
    """Raise InputError if two members have one name."""
    name, count = Counter(map(_name, members)).most_common(1)[0] if members else ("", 0)
    if count > 1:
        raise InputError(f"holds the array {name} twice")


def _require_moderate(members: Sequence[zipfile.ZipInfo], size: int) -> None:
    """Raise InputError if members of an archive of `size` bytes unpack to more than is allowed."""
    unpacked, most = sum(member.file_size for member in members), max(FREE_BYTES, MOST_RATIO * size)
    if unpacked > most:
        raise InputError(
            f"unpacks to {unpacked / 2**20:.0f} MB, expected at most {most / 2**20:.0f} MB from {size} bytes"
        )


def _read(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """The array of a member; InputError without the path if it is not one."""
    # numpy writes no others, and some of them take the memory that their own headers ask for.
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(f"{_name(member)} is compressed in another way than an npz")
    with archive.open(member) as stream:
        header = _header(stream, _name(member))
        count = math.prod(header.shape)
        claimed, stored = count * header.dtype.itemsize, member.file_size - header.size
        if claimed != stored or (count == 0 and max(header.shape) > MOST_ROWS):
            raise InputError(
                f"{_name(member)} has the shape {header.shape} with {header.dtype.itemsize} bytes an "
                f"element, but {stored} bytes of data"
            )
        values = np.empty(count, header.dtype)
        place = values.view(np.uint8).data if claimed else memoryview(b"")
        for start in range(0, claimed, CHUNK):
            place[start : start + CHUNK] = stream.read(min(CHUNK, claimed - start))
        # Only at its end is a member's checksum compared.
        stream.read(1)
    array = _plain(values.astype(header.dtype.newbyteorder("="), copy=False), _name(member))
    return np.asarray(array.reshape(header.shape, order="F" if header.fortran else "C"), order="C")


def _plain(values: np.ndarray, name: str) -> np.ndarray:
    """Values (N,) as numpy itself would write them; raises InputError for texts of no characters."""
    if values.dtype.kind == "b":
        return values.view(np.uint8) != 0
    if values.dtype.kind == "U":
        codes = values.view(np.uint32)
        if ((codes > 0x10FFFF) | ((codes >= 0xD800) & (codes <= 0xDFFF))).any():
            raise InputError(f"{name} contains a text with an invalid character")
    return values


def _header(stream: IO[bytes], name: str) -> Header:
    """Read the header of an array; raises InputError that names the array if it is invalid."""
    start = stream.read(len(MAGIC) + 2)
    length_size = {1: 2, 2: 4, 3: 4}.get(start[-2] if len(start) == len(MAGIC) + 2 else 0)
    if not start.startswith(MAGIC) or length_size is None:
        raise InputError(f"{name} is not a numpy array")
    length = int.from_bytes(stream.read(length_size), "little")
    if length > MOST_HEADER:
        raise InputError(f"{name} has a header of {length} bytes, expected at most {MOST_HEADER}")
    content = stream.read(length)
    text = content.decode("latin1")
    entries = dict(re.findall(ENTRY, text)) if HEADER.fullmatch(text) else {}
    if len(content) < length or len(entries) < 3:
        raise InputError(f"{name} {_why_no_array(text)}")
    return Header(
        _dtype(entries["descr"].strip("'"), name),
        tuple(int(size) for size in re.findall(r"\d+", entries["shape"])),
        entries["fortran_order"] == "True",
        len(start) + length_size + length,
    )


def _why_no_array(header: str) -> str:
    if "'|O'" in header:
        return "is pickled, expected plain arrays; nothing is unpickled"
    return "has a header that says no type, order and shape of plain numbers"


def _dtype(text: str, name: str) -> np.dtype:
    if text == "|O":
        raise InputError(f"{name} is pickled, expected plain arrays; nothing is unpickled")
    match = TYPES.fullmatch(text)
    known = match and (match["flag"] or match["kind"] == "U" or int(match["size"]) in SIZES[match["kind"]])
    if not known:
        raise InputError(f"{name} is of the type {text[:40]!r}, expected numbers or texts")
    return np.dtype(text.replace("?", "b1"))
