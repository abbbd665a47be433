"""Frames of a garment for a web page, which plays them where a browser cannot compute them in time."""

import numpy as np
from numpy.typing import NDArray

from uvcloth.formats.moving import QUANTIZATION_STEP, pack
from uvcloth.writers.page_arrays import pack_arrays


def pack_frames(vertices: NDArray[np.float32], faces: NDArray[np.int64], first: int = 0) -> bytes:
    """Pack the vertices (F, N, 3) m of a mesh with faces (M, 3), to within 0.05 mm; `frames.js` reads them.

    first: frame of the page's animation that the first one belongs to. Raises ValueError for vertices that
    move too far from frame to frame, see `uvcloth.formats.moving.pack`.
    """
    packed = pack(vertices, faces)
    if packed["changes"].dtype != np.uint8:
        raise ValueError("its vertices jump")
    arrays = {
        name: values if name == "changes" else values.astype(np.int32) for name, values in packed.items()
    }
    return pack_arrays(
        arrays, frames=len(vertices), vertices=vertices.shape[1], first=first, step=QUANTIZATION_STEP
    )
