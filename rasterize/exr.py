"""Named float channels in OpenEXR files, and pictures of other formats, through OpenImageIO."""

import errno
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np


def write_exr(path: Path, channels: Mapping[str, np.ndarray], half: bool = True) -> None:
    """Write channels (H, W) by name, zip-compressed, as half or 32-bit floats.

    Raises OSError, as `write_image` does.
    """
    pixels = np.stack(list(channels.values()), axis=-1)
    write_image(path, pixels, "half" if half else "float", tuple(channels))


def write_image(path: Path, pixels: np.ndarray, kind: str, names: Sequence[str]) -> None:
    """Write pixels (H, W, C) with the names of their channels, in the format given by the path's suffix.

    kind: of the numbers in the file, "half", "float" or "uint8". Raises OSError, with OpenImageIO's reason,
    if the file cannot be written; an incomplete file may remain then.
    """
    import OpenImageIO

    path = Path(path)
    height, width, count = pixels.shape
    spec = OpenImageIO.ImageSpec(width, height, count, kind)
    spec.channelnames = list(names)
    spec.attribute("compression", "zip")
    if path.suffix.lower() == ".exr":
        # Otherwise it holds the time of writing, and the same maps give other bytes each time.
        spec.attribute("DateTime", "1970:01:01 00:00:00")
    output = OpenImageIO.ImageOutput.create(str(path))
    if output is None:
        # OpenImageIO prints errors that nobody reads when the program ends.
        OpenImageIO.geterror()
        reason = "OpenImageIO writes no such format, expected a name in .exr or .png"
        raise OSError(errno.EINVAL, reason, str(path))
    written = output.open(str(path), spec) and output.write_image(np.ascontiguousarray(pixels))
    if not (output.close() and written):
        raise OSError(errno.EIO, output.geterror(), str(path))
