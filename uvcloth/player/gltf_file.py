"""glTF 2.0 binary files: their JSON, checked, and the arrays of its accessors."""

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from uvcloth.player.gltf_document import check_document, parents_of

MAGIC, JSON_CHUNK, BINARY_CHUNK = b"glTF", 0x4E4F534A, 0x004E4942
TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
INDEX_TYPES = {code: TYPES[code] for code in (5121, 5123, 5125)}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

LONGEST_NAME = 200
"""Characters of a name that are kept."""

MOST_ZEROS = 1_000_000
"""Limit for the elements of an accessor without a buffer view: the file has no bytes for most of them."""

COMPRESSIONS = {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"}
"""Extensions that compress arrays, which are not read."""


@dataclass(frozen=True)
class GltfFile:
    """A glTF file, its JSON checked; all of its arrays are in it.

    document: the JSON. binary: the chunk of a .glb, for buffers without a URI. above: parent of every node
    that has one.
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
        """Values of an accessor of one of the given kinds ("VEC3"): (count, width), normalized integers as
        floats.

        Values of a sparse accessor are substituted; without a buffer view all others are zeros. Raises
        ValueError for another kind, for data that are not in the file, for more than MOST_ZEROS zeros and for
        numbers that are not finite.
        """
        entry = self.entries("accessors")[accessor]
        if entry["type"] not in kinds or entry["componentType"] not in TYPES:
            stored = f"{entry['type']:.10} of {entry['componentType']}"
            raise self.error(f"accessor {accessor} is {stored}, expected {' or '.join(kinds)}")
        kind, shape = np.dtype(TYPES[entry["componentType"]]), (entry["count"], WIDTHS[entry["type"]])
        if "bufferView" in entry:
            step = self.entries("bufferViews")[entry["bufferView"]].get("byteStride")
            values = self._elements(f"accessor {accessor}", entry, kind, shape, step)
        else:
            values = self._zeros(accessor, kind, shape)
        if "sparse" in entry:
            values = self._substituted(accessor, values)
        if kind.kind == "f" and not np.isfinite(values).all():
            raise self.error(f"accessor {accessor} holds a value that is not a finite number")
        if entry.get("normalized") and kind.kind != "f":
            largest = 2 ** (8 * kind.itemsize - (kind.kind == "i")) - 1
            return np.maximum(values / largest, -1.0)
        return values.astype(kind)

    def held(self, accessor: int) -> int:
        """Number of elements of an accessor for which the file can have bytes, whatever count it states."""
        entry = self.entries("accessors")[accessor]
        sparse = entry.get("sparse", {"count": 0})
        parts = [(entry["count"], entry), (sparse["count"], sparse.get("values", {}))]
        return sum(min(count, len(self.view(p["bufferView"]))) for count, p in parts if "bufferView" in p)

    def _zeros(self, accessor: int, kind: np.dtype, shape: tuple[int, int]) -> np.ndarray:
        """Zeros, as an accessor without a buffer view holds."""
        compressed = sorted(COMPRESSIONS.intersection(self.document.get("extensionsUsed", [])))
        if compressed:
            raise self.error(f"accessor {accessor} is {compressed_by(compressed[0])}")
        if shape[0] > MOST_ZEROS:
            raise self.error(
                f"accessor {accessor} has {shape[0]} elements without data, expected {MOST_ZEROS:,} at most"
            )
        return np.zeros(shape, kind)

    def _substituted(self, accessor: int, values: np.ndarray) -> np.ndarray:
        """The values (count, width) of a sparse accessor, some of which it replaces."""
        sparse = self.entries("accessors")[accessor]["sparse"]
        place, rows, count = f"accessor {accessor}", sparse["indices"], sparse["count"]
        if rows["componentType"] not in INDEX_TYPES or not 0 < count <= len(values):
            raise self.error(
                f"{place} is sparse with {count} indices of {rows['componentType']}, expected 1 to "
                f"{len(values)} of 5121, 5123 or 5125"
            )
        index_kind = np.dtype(INDEX_TYPES[rows["componentType"]])
        indices = self._elements(f"{place}.sparse.indices", rows, index_kind, (count, 1))[:, 0]
        indices = indices.astype(np.int64)
        if (np.diff(indices) <= 0).any() or indices[-1] >= len(values):
            raise self.error(
                f"{place} is sparse with indices that do not increase or are beyond its {len(values)}"
            )
        replaced = values.copy()
        replaced[indices] = self._elements(
            f"{place}.sparse.values", sparse["values"], values.dtype, (count, values.shape[1])
        )
        return replaced

    def _elements(
        self,
        place: str,
        part: dict[str, Any],
        kind: np.dtype,
        shape: tuple[int, int],
        step: int | None = None,
    ) -> np.ndarray:
        """Numbers of a kind and shape (count, width) in a buffer view; step: bytes from row to row."""
        (count, width), start = shape, part.get("byteOffset", 0)
        size = width * kind.itemsize
        step = size if step is None else step
        if step < size:
            raise self.error(f"{place} has elements that overlap, {step} bytes apart")
        content = self.view(part["bufferView"])
        if count and start + (count - 1) * step + size > len(content):
            raise self.error(f"{place} reaches beyond the end of its buffer view")
        start = start if count else 0
        return np.ndarray(shape, kind.newbyteorder("<"), content, start, (step, kind.itemsize))

    def view(self, index: int) -> memoryview:
        """Bytes of a buffer view, such as an image. Raises ValueError if they are not in the file."""
        view = self.entries("bufferViews")[index]
        compressed = sorted(COMPRESSIONS.intersection(view.get("extensions", ())))
        if compressed and not self._is_here(view["buffer"]):
            raise self.error(f"bufferViews[{index}] is {compressed_by(compressed[0])}")
        buffer, start = self._buffer(view["buffer"]), view.get("byteOffset", 0)
        if start + view["byteLength"] > len(buffer):
            raise self.error(f"bufferViews[{index}] reaches beyond the end of its buffer")
        return memoryview(buffer)[start : start + view["byteLength"]]

    def _is_here(self, buffer: int) -> bool:
        """True for a buffer that has bytes; one that compressed views alone would fill has none."""
        return "uri" in self.entries("buffers")[buffer] or (buffer == 0 and bool(self.binary))

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            uri = self.entries("buffers")[index].get("uri")
            self._buffers[index] = self.binary if uri is None else self.content(uri)
        return self._buffers[index]

    def content(self, uri: str) -> bytes:
        """Bytes that the file has elsewhere. Raises ValueError: there are none."""
        raise self.error("keeps its data in other files, expected all in one .glb")

    def error(self, sentence: str) -> ValueError:
        """The error that names the file and says what is wrong with it."""
        return ValueError(f"{self.path}: {sentence}")


def compressed_by(extension: str) -> str:
    """Words for a file whose arrays an extension compresses."""
    return (
        f"compressed ({extension}), which is not read: decompress it first, as in "
        "`gltf-transform copy hero.glb plain.glb`, or export it without compression"
    )


def one_line(name: Any) -> str:
    """A name from a file, in one line of at most LONGEST_NAME characters, without control characters."""
    text = "".join(letter if letter.isprintable() else " " for letter in str(name)[:LONGEST_NAME])
    return " ".join(text.split())


def read_glb(path: Path) -> GltfFile:
    """Read a .glb.

    Raises ValueError naming the file, and the place, if it is not valid, cannot be read, or is a device,
    which might never end.
    """
    path = Path(path)
    try:
        if path.exists() and not path.is_file():
            raise ValueError("no such file, this is a folder or a device")
        document, binary = parse_glb(path.read_bytes())
        return GltfFile(path, document, binary, parents_of(document))
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror or error})") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def parse_glb(content: bytes) -> tuple[dict[str, Any], bytes]:
    """JSON and binary chunk of a .glb, or the JSON of a .gltf and nothing.

    Raises ValueError with the place if it is not valid.
    """
    try:
        text, binary = _chunks(content) if content[:4] == MAGIC else (content, b"")
        document = json.loads(text)
    except (ValueError, struct.error, KeyError, RecursionError) as error:
        raise ValueError("not a complete glTF file") from error
    check_document(document)
    compressed = sorted(COMPRESSIONS.intersection(document.get("extensionsRequired", [])))
    if compressed:
        raise ValueError(f"is {compressed_by(compressed[0])}")
    return document, binary


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
