"""glTF 2.0 files: their JSON, and the arrays that its accessors name."""

import base64
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from rasterize.errors import InputError
from rasterize.reading import read_content

MAGIC, JSON_CHUNK, BINARY_CHUNK = b"glTF", 0x4E4F534A, 0x004E4942
TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@dataclass(frozen=True)
class Gltf:
    """A glTF file. document: its JSON. binary: the chunk of a .glb that buffers without a URI mean."""

    path: Path
    document: dict[str, Any]
    binary: bytes

    def entries(self, name: str) -> list[dict[str, Any]]:
        """The entries of a top-level list ("nodes", "skins"), none if it is absent."""
        return list(self.document.get(name, []))

    def array(self, accessor: int) -> np.ndarray:
        """Values of an accessor: (count, width), normalized integers as floats.

        Raises InputError for data that are not in the file, and for sparse or compressed ones.
        """
        entry = self.entries("accessors")[accessor]
        if "sparse" in entry or "bufferView" not in entry:
            raise InputError(f"{self.path}: accessor {accessor} is sparse or compressed, which is not read")
        view = self.entries("bufferViews")[entry["bufferView"]]
        kind = np.dtype(TYPES[entry["componentType"]]).newbyteorder("<")
        width, count = WIDTHS[entry["type"]], entry["count"]
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        step = view.get("byteStride", width * kind.itemsize)
        buffer = self._buffer(view["buffer"])
        if count and start + (count - 1) * step + width * kind.itemsize > len(buffer):
            raise InputError(f"{self.path}: accessor {accessor} reaches beyond the end of its buffer")
        values = np.ndarray((count, width), kind, buffer, start, (step, kind.itemsize))
        if entry.get("normalized"):
            largest = 2 ** (8 * kind.itemsize - (kind.kind == "i")) - 1
            return np.maximum(values / largest, -1.0)
        return values.astype(kind.newbyteorder("="))

    def view(self, index: int) -> bytes:
        """Bytes of a buffer view, such as an image."""
        view = self.entries("bufferViews")[index]
        start = view.get("byteOffset", 0)
        return self._buffer(view["buffer"])[start : start + view["byteLength"]]

    def _buffer(self, index: int) -> bytes:
        uri = self.entries("buffers")[index].get("uri")
        if uri is None:
            return self.binary
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        file = self.path.parent / unquote(uri)
        try:
            return file.read_bytes()
        except OSError as error:
            raise InputError(f"{self.path}: its buffer {file} cannot be read ({error.strerror})") from error


def read_gltf(path: Path) -> Gltf:
    """Read a .glb or .gltf file. Raises InputError naming the file if it is none."""
    path = Path(path)
    content = read_content(path)
    try:
        text, binary = _chunks(content) if content[:4] == MAGIC else (content, b"")
        document = json.loads(text)
    except (ValueError, struct.error, KeyError) as error:
        raise InputError(f"{path}: not a whole glTF file") from error
    if not isinstance(document, dict) or "asset" not in document:
        raise InputError(f"{path}: not a glTF file, it has no asset")
    return Gltf(path, document, binary)


def _chunks(content: bytes) -> tuple[bytes, bytes]:
    """JSON and binary chunk of a .glb."""
    if len(content) < struct.unpack_from("<I", content, 8)[0]:
        raise ValueError("truncated")
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= len(content):
        length, kind = struct.unpack_from("<II", content, at)
        chunks.setdefault(kind, content[at + 8 : at + 8 + length])
        at += 8 + length
    return chunks[JSON_CHUNK], chunks.get(BINARY_CHUNK, b"")
