"""Atomic writing of files: they appear whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from rasterize.errors import InputError


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Temporary path to write to instead of `path`: the same name in a folder beside it, moved at the end.

    If the block raises, nothing is left and an older file stays. Folders above are made.
    Raises InputError naming `path` if the system refuses anything in the block.
    """
    path = Path(path)
    make_folder(path.parent)
    try:
        with TemporaryDirectory(
            prefix=f".{path.name}.", suffix=".partial", dir=path.parent, ignore_cleanup_errors=True
        ) as folder:
            partial = Path(folder) / path.name
            yield partial
            os.replace(partial, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error


def make_folder(path: Path) -> None:
    """Make a folder and those above it, if they are not there. Raises InputError if that cannot be."""
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be made a folder ({error.strerror or error})") from error
