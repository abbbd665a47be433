"""Channels of an OpenEXR file, as OpenImageIO reads them."""

from pathlib import Path

import numpy as np
import OpenImageIO


def read_channels(path: Path) -> dict[str, np.ndarray]:
    """Every channel (H, W), float32, by its name."""
    image = OpenImageIO.ImageBuf(str(path))
    assert not image.has_error, image.geterror()
    pixels = image.get_pixels(OpenImageIO.FLOAT)
    return {name: pixels[..., place] for place, name in enumerate(image.spec().channelnames)}
