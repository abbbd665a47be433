"""Read and write npz files: written whole or not at all, read without pickle."""

import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from rasterize.atomic import atomic_write
from rasterize.errors import InputError


def save_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays to a compressed npz. Raises InputError if it cannot be written or the disk is full."""
    with atomic_write(path) as partial, partial.open("wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **arrays)


def load_arrays(
    path: Path, format: str, expected: str, names: Sequence[str] = (), only: bool = False
) -> dict[str, np.ndarray]:
    """Read every array of an npz whose "format" entry equals `format`; never unpickles.

    expected: says in words what the file should be. names: arrays that it must hold. only: read no others.
    Raises InputError with the path if it is missing, damaged, not an npz, another format, or lacks an array.
    """
    data = read_arrays(path, expected, ("format", *names) if only else None)
    found = str(data.get("format", "nothing"))
    if found != format:
        raise InputError(f"{path}: expected {expected} (format {format}), found format {found}")
    missing = [name for name in names if name not in data]
    if missing:
        raise InputError(f"{path}: lacks the array {', '.join(missing)}, expected {expected}")
    return data


def read_arrays(path: Path, expected: str, names: Sequence[str] | None = None) -> dict[str, np.ndarray]:
    """Read arrays of any npz, those of some names that it has, or all; never unpickles.

    expected: says in words what the file should be. Raises InputError with the path if it is missing,
    damaged or not an npz, and naming an array of those that are read if it is pickled.
    """
    with _opened(path, expected) as archive:
        return {name: _read(archive, name) for name in archive.files if names is None or name in names}


def list_arrays(path: Path, expected: str) -> tuple[str, ...]:
    """Names of the arrays of an npz. Raises InputError as `read_arrays` does."""
    with _opened(path, expected) as archive:
        return tuple(archive.files)


@contextmanager
def _opened(path: Path, expected: str) -> Iterator[np.lib.npyio.NpzFile]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            yield archive
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    # Between them, numpy and zipfile raise all of these for damaged bytes, the last two for a renamed npy.
    except (
        *(OSError, ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error),
        *(TypeError, AttributeError),
    ) as error:
        raise InputError(f"{path}: not a readable npz, expected {expected}") from error


def _read(archive: np.lib.npyio.NpzFile, name: str) -> np.ndarray:
    try:
        return archive[name]
    except ValueError as error:
        if "allow_pickle" not in str(error):
            raise
        raise InputError(f"{name} is pickled, expected plain arrays; nothing is unpickled") from error


def require_finite(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Raise InputError naming the file and the array if any float is not a finite number."""
    for name, values in arrays.items():
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise InputError(f"{path}: {name} holds a value that is not a finite number")
