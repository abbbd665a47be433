"""Results kept for a rerun: npz files with a hash, which are refused if they were changed."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.geometry.fingerprint import fingerprint

CONTENT = "content"
"""Array with the hash of the others."""


def keep_arrays(path: Path, format: str, arrays: Mapping[str, np.ndarray], compressed: bool = True) -> None:
    """Write arrays and their hash to an npz. Raises InputError if it cannot be written."""
    whole = {"format": np.array(format), **arrays}
    save_arrays(path, {**whole, CONTENT: np.array(_content(whole))}, compressed)


def kept_arrays(path: Path, format: str, expected: str) -> dict[str, np.ndarray]:
    """Read the arrays that `keep_arrays` wrote.

    Raises InputError as `load_arrays` does, and if any of them has changed since.
    """
    arrays = load_arrays(path, format, f"{expected}; delete the file to make it again")
    if str(arrays.pop(CONTENT, "")) != _content(arrays):
        raise InputError(
            f"{path}: was changed after it was written, expected {expected}; delete it to make it again"
        )
    return arrays


def _content(arrays: Mapping[str, np.ndarray]) -> str:
    """Hash of names, types, shapes and values."""
    parts: list[str | bytes] = []
    for name, array in sorted(arrays.items()):
        parts += [f"{name} {array.dtype.str} {array.shape} ", np.ascontiguousarray(array).tobytes()]
    return fingerprint(*parts)
