"""Fields of files of arrays: the shape, the kind and the range that each array has to have.

Sizes are letters that agree within a file: {"vertices": numbers("V", 3), "faces": indices("F", 3, of="V")}
says that faces are rows of three indices into the vertices.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.errors import InputError

MOST = 1e9
"""Greatest absolute value of a number of a file, so that products of a few stay finite in float32."""

LONGEST = 1000
"""Limit for the characters of a name."""

LONGEST_FILE_NAME = 220
"""Bytes of the name of a file, in UTF-8; systems allow 255."""

FORBIDDEN = frozenset('<>:"|?*/\\')
"""Characters that the name of a file may not have on Windows."""

DEVICES = frozenset(
    ["CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"]
    + [port + digit for port in ("COM", "LPT") for digit in "123456789¹²³"]
)
"""Names of devices on Windows, in upper or lower case and with any suffix."""

KINDS = {"numbers": "fiu", "whole numbers": "iu", "truth values": "b", "names": "U", "text": "U"}
"""Kinds of values in words, and the numpy kinds that are read as each."""


@dataclass(frozen=True)
class Field:
    """One array of a file.

    shape: numbers, or letters for sizes that agree within the file. kind: of KINDS. dtype: to which it is
    converted, None to keep it. least, most: between which every value lies, both included; most may be a
    size's letter, for indices below it. optional: whether it may be missing. may_be_empty: whether its first
    axis may have no rows instead.
    """

    shape: tuple[int | str, ...]
    kind: str
    dtype: type | None = None
    least: float = -MOST
    most: float | str = MOST
    optional: bool = False
    may_be_empty: bool = False

    def if_there(self) -> "Field":
        """The field as one that may be missing."""
        return replace(self, optional=True)

    def or_empty(self) -> "Field":
        """The field as one that may have no rows, whatever others have."""
        return replace(self, may_be_empty=True)


def numbers(*shape: int | str, least: float = -MOST, most: float = MOST, dtype: type = np.float32) -> Field:
    """Numbers that are finite."""
    return Field(shape, "numbers", dtype, least, most)


def indices(*shape: int | str, of: str, least: int = 0) -> Field:
    """Whole numbers from `least` up to below the size `of`, as int64."""
    return Field(shape, "whole numbers", np.int64, least, of)


def whole(*shape: int | str, least: int = 0, most: int = int(MOST), dtype: type = np.int64) -> Field:
    """Whole numbers."""
    return Field(shape, "whole numbers", dtype, least, most)


def flags(*shape: int | str) -> Field:
    """Truth values."""
    return Field(shape, "truth values")


def names(*shape: int | str) -> Field:
    """Texts of printable characters, at most LONGEST each."""
    return Field(shape, "names")


def text() -> Field:
    """Any text."""
    return Field((), "text")


def is_file_name(name: str) -> bool:
    """Test for a name that is safe as a file's, or a part of it, on every system.

    Printable, without folders, not of a device, with no end or character that Windows forbids, and of less
    than LONGEST_FILE_NAME bytes, so that a suffix and a mark of what is unfinished find room.
    """
    return (
        name.isprintable()
        and 0 < len(name.encode()) < LONGEST_FILE_NAME
        and not FORBIDDEN & set(name)
        and name[-1] not in ". "
        and name.partition(".")[0].rstrip().upper() not in DEVICES
    )


def require_file_name(name: str, owner: str | Path) -> None:
    """Raise InputError that names the owner unless a name passes `is_file_name`."""
    if not is_file_name(name):
        raise InputError(
            f"{owner}: {name!r:.60} cannot be the name of a file on every system (Windows forbids "
            '<>:"|?*, a dot or space at the end, and names of devices; the limit is 220 bytes), rename it'
        )


def safe_file_name(name: str) -> str:
    """A name in which underscores replace the characters that a file's name cannot have; for a device, and at
    the end, with one more.
    """
    safe = "".join("_" if each in FORBIDDEN or not each.isprintable() else each for each in name)
    safe = safe.encode()[: LONGEST_FILE_NAME // 2].decode(errors="ignore")
    return safe if is_file_name(safe) else f"_{safe}_"


def check_fields(
    path: Path, arrays: Mapping[str, np.ndarray], fields: Mapping[str, Field], **sizes: int
) -> dict[str, Any]:
    """The arrays of some fields, checked and converted.

    sizes: those that are known beforehand. Raises InputError naming the file, the array and what was
    expected of it, if it is missing or has another shape or kind, and for a value that is not finite or
    out of range.
    """
    values: dict[str, Any] = {}
    for name, field in fields.items():
        if name in arrays:
            _require_kind(path, name, arrays[name], field)
            _require_shape(path, name, arrays[name], field, sizes)
        elif not field.optional:
            raise InputError(f"{path}: lacks the array {name}")
    for name, field in fields.items():
        if name in arrays:
            values[name] = _converted(path, name, arrays[name], field, sizes)
    return values


def _require_kind(path: Path, name: str, array: np.ndarray, field: Field) -> None:
    if array.dtype.kind not in KINDS[field.kind]:
        raise InputError(f"{path}: {name} holds {array.dtype.name}, expected {field.kind}")


def _require_shape(path: Path, name: str, array: np.ndarray, field: Field, sizes: dict[str, int]) -> None:
    """Raise InputError for another shape than the field's; letters that are new take their sizes from it."""
    if field.may_be_empty and array.shape == (0, *field.shape[1:]):
        return
    expected = tuple(sizes.get(size, size) if isinstance(size, str) else size for size in field.shape)
    fits = array.ndim == len(expected) and all(
        isinstance(size, str) or size == there for size, there in zip(expected, array.shape, strict=True)
    )
    if not fits:
        words = ", ".join(map(str, expected)) + ("," if len(expected) == 1 else "")
        raise InputError(f"{path}: {name} has the shape {array.shape}, expected ({words})")
    sizes |= {size: there for size, there in zip(expected, array.shape, strict=True) if isinstance(size, str)}


def _converted(
    path: Path, name: str, array: np.ndarray, field: Field, sizes: Mapping[str, int]
) -> np.ndarray:
    if field.kind in ("numbers", "whole numbers") and array.size:
        most = sizes[field.most] - 1 if isinstance(field.most, str) else field.most
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise InputError(f"{path}: {name} holds a value that is not a finite number")
        low, high = array.min().item(), array.max().item()
        if low < field.least or high > most:
            wrong = low if low < field.least else high
            raise InputError(f"{path}: {name} holds {wrong:g}, expected {field.least:g} to {most:g}")
    for word in array.reshape(-1).tolist() if field.kind == "names" else ():
        if len(word) > LONGEST or not word.isprintable():
            raise InputError(f"{path}: {name} holds {word[:40]!r}, expected printable names")
    return array if field.dtype is None else array.astype(field.dtype, copy=False)
