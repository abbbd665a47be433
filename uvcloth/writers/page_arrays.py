"""Files of arrays that `arrays.js` of a web page reads: a header and the arrays, deflated."""

import json
import struct
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

KINDS = ("int8", "uint8", "uint16", "int32", "float16", "float32")
"""Types of arrays that the page reads."""

ALIGNMENT = 8
"""Bytes at whose multiples every array begins."""


def pack_arrays(arrays: Mapping[str, NDArray[Any]], **header: Any) -> bytes:
    """Pack arrays by name, and a header of JSON values."""
    places, parts, size = {}, [], 0
    for name, array in arrays.items():
        assert array.dtype.name in KINDS, name
        content = np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<"), copy=False).tobytes()
        places[name] = {"kind": array.dtype.name, "start": size, "count": array.size}
        content += b"\0" * (-len(content) % ALIGNMENT)
        parts.append(content)
        size += len(content)
    text = json.dumps(header | {"arrays": places}).encode()
    text += b" " * (-(len(text) + 4) % ALIGNMENT)
    return zlib.compress(b"".join([struct.pack("<I", len(text)), text, *parts]), 9)
