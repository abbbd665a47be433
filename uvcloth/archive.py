"""npz files that are written whole or not at all, and read without pickle."""

import os
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from rasterize.errors import InputError


def save_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays to a compressed npz beside the target, then rename, so no half file is ever left.

    Raises InputError if the folder cannot be written or the disk is full.
    """
    path = Path(path)
    partial = path.with_name(path.name + ".partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, **arrays)
        os.replace(partial, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def load_arrays(path: Path, format: str, expected: str) -> dict[str, np.ndarray]:
    """Read every array of an npz whose "format" entry equals `format`; never unpickles.

    Raises InputError with the path if it is missing, truncated, not an npz, or another format;
    `expected` says in words what the file should have been.
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            data = {name: archive[name] for name in archive.files}
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, AttributeError) as error:
        raise InputError(f"{path}: not a readable npz, expected {expected}") from error
    found = str(data.get("format", "nothing"))
    if found != format:
        raise InputError(f"{path}: expected {expected} (format {format}), found format {found}")
    return data
