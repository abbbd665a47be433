"""Named float channels in OpenEXR files, and pictures, through OpenImageIO."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rasterize.errors import InputError
from uvcloth.files.atomic import atomic_write, require_room
from uvcloth.files.reading import require_file

END_OF_PNG = b"\0\0\0\0IEND\xae\x42\x60\x82"


def write_exr(path: Path, channels: Mapping[str, np.ndarray], half: bool = True) -> None:
    """Write channels (H, W) by name, zip-compressed, as half or 32-bit floats, whole or not at all.

    Raises InputError if the file cannot be written.
    """
    pixels = np.stack([channels[name] for name in channels], axis=-1)
    _write(Path(path), pixels, "half" if half else "float", list(channels))


def write_png(path: Path, picture: np.ndarray) -> None:
    """Write a picture (H, W, 3), uint8 or values in [0, 1], whole or not at all.

    Raises InputError if the file cannot be written.
    """
    _write(Path(path), picture, "uint8", ["R", "G", "B"])


def _write(path: Path, pixels: np.ndarray, kind: str, names: list[str]) -> None:
    import OpenImageIO

    height, width, count = pixels.shape
    spec = OpenImageIO.ImageSpec(width, height, count, kind)
    spec.channelnames = names
    spec.attribute("compression", "zip")
    if path.suffix.lower() == ".exr":
        # Else it holds the moment of writing, and the same maps are other bytes each time.
        spec.attribute("DateTime", "1970:01:01 00:00:00")
    with atomic_write(path) as partial:
        # The ending tells OpenImageIO the format.
        output = OpenImageIO.ImageOutput.create(str(partial))
        if output is None:
            raise InputError(f"{path}: OpenImageIO writes no such format, expected a name in .exr or .png")
        written = output.open(str(partial), spec) and output.write_image(np.ascontiguousarray(pixels))
        written = bool(output.close() and written)
        # A disk that is full for the last bytes of a PNG goes unnoticed there.
        if written and partial.suffix.lower() == ".png":
            written = partial.read_bytes().endswith(END_OF_PNG)
        if not written:
            require_room(partial.parent)
            raise InputError(f"{path}: cannot be written ({output.geterror()})")


def read_exr(path: Path) -> dict[str, np.ndarray]:
    """Read every channel (H, W) float32 by its name. Raises InputError if the file is missing or damaged."""
    import OpenImageIO

    path = Path(path)
    require_file(path)
    source = OpenImageIO.ImageInput.open(str(path))
    if source is None:
        raise InputError(f"{path}: not a readable image ({OpenImageIO.geterror()})")
    try:
        pixels = source.read_image("float")
        if pixels is None:
            raise InputError(f"{path}: the image is damaged ({source.geterror()})")
        names = source.spec().channelnames
    finally:
        source.close()
    pixels = pixels.reshape(pixels.shape[0], pixels.shape[1], -1)
    return {name: np.ascontiguousarray(pixels[..., channel]) for channel, name in enumerate(names)}
