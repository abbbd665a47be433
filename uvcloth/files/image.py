"""Pictures and maps in files: written whole or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from rasterize.exr import write_image
from uvcloth.errors import InputError, cause
from uvcloth.files.atomic import atomic_write, require_room
from uvcloth.files.reading import require_file

END_OF_PNG = b"\0\0\0\0IEND\xae\x42\x60\x82"

MOST_PIXELS = 100_000_000
"""Limit for the pixels of a picture that is read."""


def read_picture(path: Path) -> np.ndarray:
    """Read a picture, upright as its camera says: (H, W, 3) uint8, without transparency.

    Raises InputError naming the file if it is missing, no picture, or has more than MOST_PIXELS.
    """
    import OpenImageIO

    require_file(path)
    source = OpenImageIO.ImageInput.open(str(path))
    if source is None:
        raise InputError(f"{path}: cannot be read as a picture ({_reason(OpenImageIO.geterror())})")
    spec = source.spec()
    source.close()
    if not 0 < spec.width * spec.height <= MOST_PIXELS:
        raise InputError(f"{path}: has {spec.width} x {spec.height} pixels, expected at most {MOST_PIXELS:,}")
    picture = OpenImageIO.ImageBuf(str(path))
    if not picture.read(force=True) or picture.has_error:
        raise InputError(f"{path}: cannot be read as a picture ({_reason(picture.geterror())})")
    pixels = OpenImageIO.ImageBufAlgo.reorient(picture).get_pixels("uint8")
    if pixels is None:
        raise InputError(f"{path}: cannot be read as a picture (no pixels)")
    return pixels[..., [0, 0, 0]] if pixels.shape[2] < 3 else pixels[..., :3].copy()


def write_png(path: Path, picture: np.ndarray) -> None:
    """Write a picture (H, W, 3), uint8 or values in [0, 1], whole or not at all.

    Raises InputError if the file cannot be written.
    """
    with atomic_image(path) as partial:
        write_image(partial, picture, "uint8", ("R", "G", "B"))
        # A disk that is full for the last bytes of a PNG goes unnoticed by OpenImageIO.
        if partial.suffix.lower() == ".png" and not partial.read_bytes().endswith(END_OF_PNG):
            raise OSError("the picture is incomplete")


@contextmanager
def atomic_image(path: Path) -> Iterator[Path]:
    """Temporary path to write an image to, as `atomic_write` gives one.

    OpenImageIO does not always say why it could not write: a full disk is then named in the InputError.
    """
    with atomic_write(path) as partial:
        try:
            yield partial
        except OSError:
            require_room(partial.parent)
            raise


def _reason(text: str) -> str:
    """Words of OpenImageIO on one line."""
    return cause(OSError(text or "no pixels"))
