"""Damage to npz files: arrays of another kind, headers that claim much, members that unpack to gigabytes."""

import io
import lzma
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random

import numpy as np

from tests.fuzz.json_mutators import DEEP
from tests.fuzz.target import Mutator
from tests.fuzz.text_mutators import NUMBERS

Members = list[tuple[str, bytes]]
"""Names and contents of an archive's members, in order; a name may stand there twice."""

MAGIC = b"\x93NUMPY"

DTYPES = (
    *(
        "f2",
        "f4",
        "f8",
        ">f4",
        ">f8",
        "i1",
        "i2",
        "i4",
        "i8",
        "u1",
        "u2",
        "u4",
        "u8",
        ">i4",
        "?",
        "c8",
        "c16",
    ),
    *("U5", "S5", "M8[s]", "m8[s]", "g"),
)
DESCRIPTIONS = (
    *(
        "'|O'",
        "'<f4'",
        "'>f4'",
        "'<f16'",
        "'<U999999999'",
        "'<c8'",
        "[('a', '<f4'), ('b', '|O')]",
        "'V8'",
        "''",
    ),
    *("'<M8[s]'", "('<f4', (100000, 100000))", "None", "1", "'<f4'*10**9", "__import__('os')"),
)
SHAPES = (
    *(
        "(10000000000,)",
        "(100000, 100000)",
        "(99999999999999999999999, 3)",
        "(-1,)",
        "(-3, 3)",
        "(2**60,)",
        "()",
    ),
    *("(0,)", "(3,)", "(3, -1)", "('a',)", "3", "None", "(1.5,)", "(" + "1, " * 70 + ")", "[3]", "(True, 3)"),
)
HEADERS = (
    *(
        "[]",
        "{}",
        "1",
        "None",
        "'x'",
        "{'descr': '<f4'}",
        "(" * 300,
        "{" * 5000,
        "",
        "\0" * 50,
        "{'a': 1, 'b': 2}",
    ),
    *(
        "__import__('os').system('true')",
        "{'descr': '<f4', 'fortran_order': 'yes', 'shape': (3,)}",
        "lambda: 0",
    ),
    *(
        "{'descr': '<f4', 'fortran_order': False, 'shape': (3,), 'more': 1}",
        "9" * 6000,
        "ß" * 20,
        "1 + 1j",
        DEEP,
    ),
)


def change_values(path: Path, random: Random) -> str:
    """Some numbers of an array out of bounds."""

    def change(array: np.ndarray) -> np.ndarray:
        flat = array.copy().reshape(-1)
        if flat.dtype.kind in "US":
            return np.array(random.choice(("", "x", "a" * 10_000, "../x", "{", "NaN", DEEP)))
        if flat.size == 0 or flat.dtype.kind not in "fiubc":
            return array
        count = random.choice((1, 1, 3, flat.size))
        rows = np.array([random.randrange(flat.size) for _ in range(min(count, 200))])
        values = (
            0,
            -1,
            1,
            2,
            1000,
            -1e30,
            1e39,
            np.nan,
            np.inf,
            -np.inf,
            1e-30,
            2**31,
            2**62,
            -(2**63),
            0.3,
            255,
        )
        value = random.choice(values)
        with np.errstate(all="ignore"):
            if flat.dtype.kind in "iu":
                info = np.iinfo(flat.dtype)
                value = 0 if np.isnan(value) else int(min(max(value, info.min), info.max))
            flat[rows if count < flat.size else slice(None)] = value
        return flat.reshape(array.shape)

    return _change_array(path, random, change, "values changed")


def change_dtype(path: Path, random: Random) -> str:
    dtype = random.choice(DTYPES)

    def change(array: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            try:
                return array.astype(dtype)
            except (TypeError, ValueError):
                return np.zeros(array.shape, dtype)

    return _change_array(path, random, change, f"now of type {dtype}")


def add_imaginary(path: Path, random: Random) -> str:
    return _change_array(
        path,
        random,
        lambda a: a.astype(complex) * complex(1, np.nan) if a.dtype.kind in "fiu" else a,
        "complex NaN",
    )


def change_shape(path: Path, random: Random) -> str:
    way = random.randrange(11)

    def change(array: np.ndarray) -> np.ndarray:
        shaped = np.atleast_1d(array)
        half = shaped[: len(shaped) // 2]
        ways: tuple[Callable[[], np.ndarray], ...] = (
            lambda: shaped[:-1],
            lambda: shaped[1:],
            lambda: shaped[:0],
            lambda: half,
            lambda: np.concatenate([shaped, shaped]),
            lambda: shaped.reshape(-1),
            lambda: array.T,
            lambda: array[None],
            lambda: shaped[..., :-1],
            lambda: np.array(shaped.reshape(-1)[0]) if shaped.size else shaped,
            lambda: np.zeros((0, *shaped.shape[1:], 0), array.dtype),
        )
        return ways[way]()

    return _change_array(path, random, change, f"of another shape (way {way})")


def shuffle_rows(path: Path, random: Random) -> str:
    def change(array: np.ndarray) -> np.ndarray:
        if array.ndim == 0 or not len(array):
            return array
        order = np.arange(len(array))
        np.random.default_rng(random.randrange(2**32)).shuffle(order)
        return array[order]

    return _change_array(path, random, change, "rows shuffled")


def fortran_order(path: Path, random: Random) -> str:
    return _change_array(path, random, np.asfortranarray, "in Fortran order")


def pickle_array(path: Path, random: Random) -> str:
    return _change_array(path, random, lambda a: np.array([a, None], dtype=object), "pickled")


def edit_header(path: Path, random: Random) -> str:
    """A header that claims another type, order or shape than the member has, or is none."""
    members = _members(path)
    if not members:
        return "no members"
    index = random.randrange(len(members))
    name, content = members[index]
    kind = random.randrange(4)
    data = content[_header_end(content) :]
    shape, description = random.choice(SHAPES), random.choice(DESCRIPTIONS)
    array = _array(content)
    if kind == 0:
        header = random.choice(HEADERS)
    elif kind == 1:
        description = repr(array.dtype.str) if array is not None else "'<f4'"
        header = f"{{'descr': {description}, 'fortran_order': False, 'shape': {shape}}}"
    elif kind == 2:
        shape = str(array.shape) if array is not None else "(3,)"
        header = f"{{'descr': {description}, 'fortran_order': False, 'shape': {shape}}}"
    else:
        header = f"{{'descr': {description}, 'fortran_order': True, 'shape': {shape}}}"
    members[index] = (name, _npy(header, data, random.choice((1, 1, 1, 2, 3))))
    _write(path, members, random)
    return f"{name} has the header {header[:100]}"


def lie_about_header(path: Path, random: Random) -> str:
    """A header whose version or length is another."""
    members = _members(path)
    if not members:
        return "no members"
    index = random.randrange(len(members))
    name, content = members[index]
    changed = bytearray(content)
    if random.random() < 0.5:
        changed[6:8] = bytes((random.choice((0, 2, 3, 4, 9, 255)), random.choice((0, 1))))
    else:
        changed[8:10] = struct.pack("<H", random.choice((0, 1, 10, 65535)))
    members[index] = (name, bytes(changed))
    _write(path, members, random)
    return f"the header of {name} lies about its length or version"


def change_members(path: Path, random: Random) -> str:
    """Members missing, doubled, renamed, exchanged, or none of numpy's."""
    members = _members(path)
    if not members:
        return "no members"
    index = random.randrange(len(members))
    name, content = members[index]
    way = random.randrange(9)
    if way == 0:
        del members[index]
    elif way == 1:
        members.append((name, random.choice(members)[1]))
    elif way == 2:
        renamed = random.choice(("../x.npy", "/x.npy", name.upper(), name[:-4], "x/", "", ".npy", "file.npy"))
        members[index] = (renamed, content)
    elif way == 3:
        other = random.randrange(len(members))
        members[index], members[other] = (name, members[other][1]), (members[other][0], content)
    elif way == 4:
        members[index] = (name, random.choice((b"", b"text", b"PK\3\4", b"\x80\4.", MAGIC, content[:20])))
    elif way == 5:
        members[index] = (name, content[: random.randrange(len(content) + 1)])
    elif way == 6:
        members[index] = (name, content + bytes(random.choice((1, 100))))
    elif way == 7:
        members += [(f"more{number}.npy", content[:200]) for number in range(random.choice((1, 2000)))]
    else:
        members = []
    _write(path, members, random)
    return f"members changed at {name} (way {way})"


def unpack_to_much(path: Path, random: Random) -> str:
    """A member of a few kilobytes that unpacks to gigabytes of zeros, its header true or false."""
    members = _members(path)
    if not members:
        return "no members"
    index = random.randrange(len(members))
    name, content = members[index]
    size = random.choice((3 << 30, 100 << 30))
    array = _array(content)
    row = array.shape[1:] if array is not None and array.ndim else ()
    kind = array.dtype.str if array is not None and array.dtype.kind in "fiu" else "<f4"
    rows = size // (int(np.prod(row)) or 1) // np.dtype(kind).itemsize
    honest = random.random() < 0.6
    shape = (rows, *row) if honest else (array.shape if array is not None else (3,))
    header = _npy(f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}}}", b"", 1)
    claim = random.choice((size, size, size & 0xFFFFFFFF, 1000))
    _write_bomb(
        path, [each for number, each in enumerate(members) if number != index], name, header, size, claim
    )
    return f"{name} unpacks to {size >> 30} GB, says {claim} bytes and {shape}"


def compress_otherwise(path: Path, random: Random) -> str:
    """Stored, or compressed in another way that zip files know."""
    members = _members(path)
    way = random.choice((zipfile.ZIP_STORED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA))
    with zipfile.ZipFile(path, "w", way) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return f"compressed in way {way}"


def rename_to_npy(path: Path, random: Random) -> str:
    """One array alone, as an npy, in the file's place."""
    members = _members(path)
    path.write_bytes(random.choice(members)[1] if members else b"")
    return "an npy in its place"


def change_text(path: Path, random: Random) -> str:
    """JSON or a name within an array of text, its numbers replaced."""

    def change(array: np.ndarray) -> np.ndarray:
        if array.dtype.kind != "U" or not array.size:
            return array
        flat = array.reshape(-1).astype(object)
        row = random.randrange(len(flat))
        words = (
            random.choice(NUMBERS),
            "null",
            "[]",
            "{}",
            "\0",
            "../x",
            flat[row][:-1],
            flat[row] + "}",
            DEEP,
        )
        flat[row] = random.choice(
            (random.choice(words), flat[row].replace(":", random.choice((": [", ": -", ": 1e"))))
        )
        return np.array(flat.tolist()).reshape(array.shape)

    return _change_array(path, random, change, "text changed")


def _change_array(path: Path, random: Random, change: Callable[[np.ndarray], np.ndarray], words: str) -> str:
    members = _members(path)
    arrays = [
        (index, array) for index, (_, content) in enumerate(members) if (array := _array(content)) is not None
    ]
    if not arrays:
        return "no arrays"
    index, array = random.choice(arrays)
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.asanyarray(change(array)), allow_pickle=True)
    members[index] = (members[index][0], stream.getvalue())
    _write(path, members, random)
    return f"{members[index][0]}: {words}"


DAMAGED = (
    *(OSError, ValueError, EOFError, RuntimeError, struct.error),
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError),
)
"""What zipfile raises for archives that an earlier mutation has damaged."""


def _members(path: Path) -> Members:
    """Members of an archive, none where an earlier mutation left no archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            return [
                (info.filename, _read(archive, info)) for info in archive.infolist() if info.file_size < 10**8
            ]
    except DAMAGED:
        return []


def _read(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """Read a member no further than the size it claims, to which a bomb does not keep."""
    with archive.open(member) as stream:
        return stream.read(member.file_size)


def _array(content: bytes) -> np.ndarray | None:
    try:
        return np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    except Exception:  # A damaged member is no array, whatever numpy says.
        return None


def _header_end(content: bytes) -> int:
    return 10 + int.from_bytes(content[8:10], "little") if content.startswith(MAGIC) else 0


def _npy(header: str, data: bytes, version: int) -> bytes:
    text = header.encode("utf-8")
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    length = struct.pack("<H" if version == 1 else "<I", len(text) % (2**16 if version == 1 else 2**32))
    return MAGIC + bytes((version, 0)) + length + text + data


def _write(path: Path, members: Members, random: Random) -> None:
    way = random.choice((zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED))
    with zipfile.ZipFile(path, "w", way, compresslevel=1) as archive:
        for name, content in members:
            # A member that has another's name is written without the warning of `writestr`.
            info = zipfile.ZipInfo(name)
            info.compress_type = way
            archive.NameToInfo.pop(name, None)
            archive.writestr(info, content)


@cache
def _packed_zeros() -> bytes:
    """16 MB of zeros, packed so that they may follow one another in a stream."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    return packer.compress(bytes(1 << 24)) + packer.flush(zlib.Z_FULL_FLUSH)


def _write_bomb(path: Path, members: Members, name: str, header: bytes, size: int, claim: int) -> None:
    """Write an archive with a last member that unpacks to a header and `size` zeros, and claims `claim`."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    start = packer.compress(header) + packer.flush(zlib.Z_FULL_FLUSH)
    # Four gigabytes' worth of zeros, however much is claimed, keep the file small and quickly written.
    packed = start + _packed_zeros() * (min(size, 4 << 30) >> 24) + packer.flush(zlib.Z_FINISH)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for other, content in members:
            archive.NameToInfo.pop(other, None)
            archive.writestr(zipfile.ZipInfo(other), content)
        info = zipfile.ZipInfo(name)
        info.compress_type, info.CRC = zipfile.ZIP_DEFLATED, 0
        info.compress_size, info.file_size = len(packed), claim
        info.header_offset = archive.fp.tell()  # type: ignore[union-attr]
        archive.fp.write(info.FileHeader(zip64=True) + packed)  # type: ignore[union-attr]
        archive.filelist.append(info)
        archive.NameToInfo[name] = info
        archive.start_dir = archive.fp.tell()  # type: ignore[union-attr]


NPZ: tuple[Mutator, ...] = (
    *(change_values, change_values, change_values, change_dtype, change_dtype, add_imaginary, change_shape),
    *(change_shape, shuffle_rows, fortran_order, pickle_array, edit_header, edit_header, lie_about_header),
    *(change_members, change_members, unpack_to_much, compress_otherwise, rename_to_npy, change_text),
)
