"""The JSON of .glb files, changed for tests of what readers refuse."""

import json
import struct
from collections.abc import Callable
from typing import Any


def edited(content: bytes, change: Callable[[dict[str, Any]], None]) -> bytes:
    """A .glb with changed JSON."""
    (length,) = struct.unpack_from("<I", content, 12)
    document = json.loads(content[20 : 20 + length])
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest
