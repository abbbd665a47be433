"""Pictures and maps in files: written whole or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from rasterize.exr import write_image
from uvcloth.files.atomic import atomic_write, require_room

END_OF_PNG = b"\0\0\0\0IEND\xae\x42\x60\x82"


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
