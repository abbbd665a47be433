"""A UV layout written to the file that `load_layout` reads."""

from pathlib import Path

import numpy as np

from rasterize.layout import Layout
from uvcloth.files.archive import save_arrays
from uvcloth.formats.layout_file import LAYOUT_FORMAT


def save_layout(layout: Layout, path: Path) -> None:
    save_arrays(
        path,
        {
            "format": np.array(LAYOUT_FORMAT),
            "faces": layout.faces.numpy().astype(np.int32),
            "uvs": layout.uvs.numpy().astype(np.float32),
            "face_uvs": layout.face_uvs.numpy().astype(np.int32),
            "islands": layout.islands.numpy().astype(np.uint8),
        },
    )
