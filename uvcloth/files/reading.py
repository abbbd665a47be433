"""Files read whole, and paths of files that other files name."""

import re
from pathlib import Path

from uvcloth.errors import InputError

ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:|[/\\]")
"""Beginning of a web address, of a drive, or of an absolute path."""

LONGEST_NAME = 1000
"""Limit for the characters of such a name."""


def read_content(path: Path) -> bytes:
    """Read a file. Raises InputError naming it if it is missing, a folder or a device, or cannot be read."""
    require_file(path)
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error


def require_file(path: Path) -> None:
    """Raise InputError unless a path is a file: a pipe or a device might never end."""
    path = Path(path)
    try:
        if path.is_file():
            return
        there = ", this is a folder or a device" if path.exists() else ""
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    raise InputError(f"{path}: no such file{there}")


def file_below(root: Path, folder: Path, name: str) -> Path:
    """Path of a file that another one in `folder` names; it has to lie in `root` or below, links followed.

    Raises InputError with the name if it lies elsewhere or is a web address: nothing is fetched.
    """
    path = folder / name
    try:
        plain = name.isprintable() and len(name) <= LONGEST_NAME and not ADDRESS.match(name)
        inside = plain and path.resolve().is_relative_to(root.resolve())
    except (OSError, RuntimeError, ValueError):  # Loops of links, names that no system takes.
        inside = False
    if not inside:
        shown = "".join(letter if letter.isprintable() else " " for letter in name[:80])
        raise InputError(f"{shown} lies outside {root.resolve().name or root} and is not read")
    return path
