"""Files read whole, and paths of files that other files name."""

import re
from pathlib import Path

from rasterize.errors import InputError

ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:|[/\\]")
"""Beginning of a web address, of a drive, or of an absolute path."""


def read_content(path: Path) -> bytes:
    """Read a file. Raises InputError naming it if it is missing, a folder or a device, or cannot be read."""
    path = Path(path)
    try:
        if not path.is_file():
            # What is no file, such as a pipe, might never end.
            raise InputError(f"{path}: {'is not a file' if path.exists() else 'no such file'}")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error


def file_below(root: Path, folder: Path, name: str) -> Path:
    """Path of a file that another one in `folder` names; it has to lie in `root` or below, links followed.

    Raises InputError with the name if it lies elsewhere or is a web address: nothing is fetched.
    """
    path = folder / name
    try:
        inside = not ADDRESS.match(name) and path.resolve().is_relative_to(root.resolve())
    except (OSError, RuntimeError, ValueError):  # Loops of links, names that no system takes.
        inside = False
    if not inside:
        raise InputError(f"{name} is not read, it lies outside {root.resolve().name or root}")
    return path
