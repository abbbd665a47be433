"""glTF 2.0 files: their JSON, and the arrays that its accessors name."""

import base64
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from rasterize.errors import InputError
from rasterize.reading import file_below, read_content
from uvcloth.geometry.gltf_document import check_document, parents_of

MAGIC, JSON_CHUNK, BINARY_CHUNK = b"glTF", 0x4E4F534A, 0x004E4942
TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

LONGEST_NAME = 200
"""Characters of a name that are kept."""

MOST_MESHES = 2000
"""Meshes, each of one material, that the nodes of a scene may place."""

COMPRESSIONS = {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"}
"""Extensions without which there are no arrays to read."""


@dataclass(frozen=True)
class Gltf:
    """A glTF file, its JSON checked.

    document: the JSON. binary: the chunk of a .glb that buffers without a URI mean. above: parent of every
    node that has one.
    """

    path: Path
    document: dict[str, Any]
    binary: bytes
    above: dict[int, int]
    _buffers: dict[int, bytes] = field(default_factory=dict, repr=False, compare=False)

    def entries(self, name: str) -> list[dict[str, Any]]:
        """The entries of a top-level list ("nodes", "skins"), none if it is absent."""
        return self.document.get(name, [])

    def array(self, accessor: int, *kinds: str) -> np.ndarray:
        """Values of an accessor of one of some kinds ("VEC3"): (count, width), normalized integers as floats.

        Raises InputError for another kind, for data that are not in the file, for sparse ones and for numbers
        that are not finite.
        """
        entry = self.entries("accessors")[accessor]
        if entry["type"] not in kinds or entry["componentType"] not in TYPES:
            found = f"{entry['type']:.10} of {entry['componentType']}"
            raise self._error(f"accessor {accessor} is {found}, expected {' or '.join(kinds)}")
        if "sparse" in entry or "bufferView" not in entry:
            raise self._error(f"accessor {accessor} is sparse or compressed, which is not read")
        view = self.entries("bufferViews")[entry["bufferView"]]
        kind = np.dtype(TYPES[entry["componentType"]]).newbyteorder("<")
        width, count, start = WIDTHS[entry["type"]], entry["count"], entry.get("byteOffset", 0)
        step = view.get("byteStride", width * kind.itemsize)
        if step < width * kind.itemsize:
            raise self._error(f"accessor {accessor} has elements that overlap, {step} bytes apart")
        content = self.view(entry["bufferView"])
        if count and start + (count - 1) * step + width * kind.itemsize > len(content):
            raise self._error(f"accessor {accessor} reaches beyond the end of its buffer view")
        values = np.ndarray((count, width), kind, content, start if count else 0, (step, kind.itemsize))
        if kind.kind == "f" and not np.isfinite(values).all():
            raise self._error(f"accessor {accessor} holds a value that is not a finite number")
        if entry.get("normalized") and kind.kind != "f":
            largest = 2 ** (8 * kind.itemsize - (kind.kind == "i")) - 1
            return np.maximum(values / largest, -1.0)
        return values.astype(kind.newbyteorder("="))

    def view(self, index: int) -> memoryview:
        """Bytes of a buffer view, such as an image. Raises InputError if they are not in the file."""
        view = self.entries("bufferViews")[index]
        buffer, start = self._buffer(view["buffer"]), view.get("byteOffset", 0)
        if start + view["byteLength"] > len(buffer):
            raise self._error(f"bufferViews[{index}] reaches beyond the end of its buffer")
        return memoryview(buffer)[start : start + view["byteLength"]]

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            uri = self.entries("buffers")[index].get("uri")
            self._buffers[index] = self.binary if uri is None else self._content(uri)
        return self._buffers[index]

    def _content(self, uri: str) -> bytes:
        """Bytes of a data URI or of a file beside this one."""
        if uri.startswith("data:"):
            return decode_data(uri)
        folder = self.path.parent
        try:
            return read_content(file_below(folder, folder, unquote(uri)))
        except InputError as error:
            raise self._error(f"its buffer {error}") from error

    def _error(self, sentence: str) -> InputError:
        return InputError(f"{self.path}: {sentence}")


def one_line(name: Any) -> str:
    """A name of a file's, in one line of at most LONGEST_NAME characters, none of which is a control code."""
    text = "".join(letter if letter.isprintable() else " " for letter in str(name)[:LONGEST_NAME])
    return " ".join(text.split())


def require_few(path: Path, meshes: int) -> None:
    """Raise InputError naming the file for more than MOST_MESHES in its scene."""
    if meshes > MOST_MESHES:
        raise InputError(f"{path}: has more than {MOST_MESHES:,} meshes, join them first")


def decode_data(uri: str) -> bytes:
    """Bytes of a data URI in base64, none if it is damaged."""
    head, _, data = uri.partition(",")
    try:
        return base64.b64decode(data) if head.endswith(";base64") else b""
    except ValueError:
        return b""


def read_gltf(path: Path) -> Gltf:
    """Read a .glb or .gltf file. Raises InputError naming the file, and the place, if it is none."""
    path = Path(path)
    content = read_content(path)
    try:
        text, binary = _chunks(content) if content[:4] == MAGIC else (content, b"")
        document = json.loads(text)
    except (ValueError, struct.error, KeyError, RecursionError) as error:
        raise InputError(f"{path}: not a whole glTF file") from error
    try:
        check_document(document)
        compressed = sorted(COMPRESSIONS.intersection(document.get("extensionsRequired", [])))
        if compressed:
            raise InputError(f"is compressed ({compressed[0]}), which is not read")
        return Gltf(path, document, binary, parents_of(document))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _chunks(content: bytes) -> tuple[bytes, bytes]:
    """JSON and binary chunk of a .glb."""
    if len(content) < struct.unpack_from("<I", content, 8)[0]:
        raise ValueError("truncated")
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= len(content):
        length, kind = struct.unpack_from("<II", content, at)
        if at + 8 + length > len(content):
            raise ValueError("truncated")
        chunks.setdefault(kind, content[at + 8 : at + 8 + length])
        at += 8 + length
    return chunks[JSON_CHUNK], chunks.get(BINARY_CHUNK, b"")
