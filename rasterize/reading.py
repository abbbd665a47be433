"""Files read whole."""

from pathlib import Path

from rasterize.errors import InputError


def read_content(path: Path) -> bytes:
    """Read a file. Raises InputError naming it if it is missing or cannot be read."""
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
