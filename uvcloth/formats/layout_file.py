"""Files of UV layouts: one npz each."""

from pathlib import Path

import torch

from rasterize.layout import Layout
from uvcloth.files.archive import load_arrays
from uvcloth.files.fields import check_fields, indices, numbers, whole

LAYOUT_FORMAT = "rasterize-layout-1"
FIELDS = {
    "faces": whole("K"),
    "uvs": numbers("U", 2, least=0.0, most=1.0),
    "face_uvs": indices("K", 3, of="U"),
    "islands": whole("K"),
}


def load_layout(path: Path) -> Layout:
    """Read a layout npz.

    Raises InputError naming the file, and the array, if it is missing, damaged, not a layout, or holds
    arrays that do not fit together, are out of range or not finite.
    """
    arrays = load_arrays(path, LAYOUT_FORMAT, "a UV layout")
    return Layout(**{name: torch.from_numpy(a) for name, a in check_fields(path, arrays, FIELDS).items()})
