"""Container of glTF 2.0 binary: JSON and one buffer, which is written piece by piece."""

import json
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uvcloth.errors import InputError

if TYPE_CHECKING:
    from uvcloth.rendering.render import Color

MAX_FILE_BYTES = 2**32 - 1
BYTE, SHORT, INT, FLOAT = 5121, 5123, 5125, 5126
COMPONENT_TYPES = {FLOAT: np.float32, INT: np.uint32, SHORT: np.uint16, BYTE: np.uint8}
VERTICES, INDICES = 34962, 34963


def index_type(count: int) -> int:
    """Smallest type for indices of `count` vertices; the greatest number of a type is none."""
    return SHORT if count < np.iinfo(np.uint16).max else INT


@dataclass
class Document:
    """Document under construction: the JSON part, and functions that yield the bytes of the binary part.

    samplers, channels: of the animation that is written, before the `animations` that were there already.
    others: entries of the top level besides those that are made here.
    """

    accessors: list[dict[str, Any]] = field(default_factory=list)
    views: list[dict[str, Any]] = field(default_factory=list)
    parts: list[Callable[[], Iterator[np.ndarray]]] = field(default_factory=list)
    length: int = 0
    nodes: list[dict[str, Any]] = field(default_factory=list)
    roots: list[int] = field(default_factory=list)
    meshes: list[dict[str, Any]] = field(default_factory=list)
    materials: list[dict[str, Any]] = field(default_factory=list)
    textures: list[dict[str, Any]] = field(default_factory=list)
    images: list[dict[str, Any]] = field(default_factory=list)
    skins: list[dict[str, Any]] = field(default_factory=list)
    samplers: list[dict[str, Any]] = field(default_factory=list)
    channels: list[dict[str, Any]] = field(default_factory=list)
    animations: list[dict[str, Any]] = field(default_factory=list)
    others: dict[str, Any] = field(default_factory=dict)

    def view(
        self,
        length: int,
        part: Callable[[], Iterator[np.ndarray]],
        target: int | None = None,
        stride: int | None = None,
    ) -> int:
        """Reserve `length` bytes (a multiple of 4), which `part` will yield when the file is written.

        stride: needed where several accessors of vertices share the view. Returns the view's index.
        """
        optional = {"target": target, "byteStride": stride}
        self.views.append(
            {"buffer": 0, "byteOffset": self.length, "byteLength": length}
            | {key: value for key, value in optional.items() if value is not None}
        )
        self.parts.append(part)
        self.length += length
        return len(self.views) - 1

    def array(
        self,
        values: np.ndarray,
        kind: str,
        component: int = FLOAT,
        target: int | None = None,
        bounds: bool = False,
    ) -> int:
        """Add an array and an accessor of it. Returns the accessor's index."""
        data = np.ascontiguousarray(values, COMPONENT_TYPES[component])
        filled = np.zeros(-data.nbytes % 4, np.uint8)
        view = self.view(data.nbytes + len(filled), lambda: iter([data, filled]), target)
        self.views[view]["byteLength"] = data.nbytes
        accessor = {"bufferView": view, "componentType": component, "count": len(data), "type": kind}
        if bounds:
            rows = data.reshape(len(data), -1)
            accessor |= {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def content(self, content: bytes) -> int:
        """Add bytes as they are. Returns the index of their view."""
        padded = np.frombuffer(content + b"\0" * (-len(content) % 4), np.uint8)
        view = self.view(len(padded), lambda: iter([padded]))
        self.views[view]["byteLength"] = len(content)
        return view

    def extend(self, name: str, extension: dict[str, Any]) -> None:
        """Add an extension, which readers may ignore, at the top level."""
        self.others["extensions"] = self.others.get("extensions", {}) | {name: extension}
        used = self.others.get("extensionsUsed", [])
        self.others["extensionsUsed"] = [*(each for each in used if each != name), name]

    def mesh(
        self, name: str, primitives: list[dict[str, Any]], skin: int | None = None, **others: Any
    ) -> int:
        """Add a mesh, and a node for it at the root of the scene. Returns the node's index."""
        self.meshes.append({"name": name, "primitives": primitives, **others})
        node = {"name": name, "mesh": len(self.meshes) - 1}
        self.nodes.append(node if skin is None else {**node, "skin": skin})
        self.roots.append(len(self.nodes) - 1)
        return len(self.nodes) - 1

    def animate(self, node: int, path: str, time: int, output: int) -> None:
        """Animate a node's translation, rotation or weights: accessors of the times and of the values."""
        self.samplers.append({"input": time, "output": output, "interpolation": "LINEAR"})
        self.channels.append({"sampler": len(self.samplers) - 1, "target": {"node": node, "path": path}})

    def material(
        self, name: str, color: "Color", opacity: float = 1.0, texture: dict[str, int] | None = None
    ) -> int:
        """Add a rough, non-metallic material of one sRGB colour, which multiplies the texture if any.

        Returns its index.
        """
        linear = [channel**2.2 for channel in color]
        surface: dict[str, Any] = {
            "baseColorFactor": [*linear, opacity],
            "metallicFactor": 0.0,
            "roughnessFactor": 0.9,
        }
        if texture:
            surface["baseColorTexture"] = texture
        material = {"name": name, "doubleSided": True, "pbrMetallicRoughness": surface}
        self.materials.append(material | ({"alphaMode": "BLEND"} if opacity < 1.0 else {}))
        return len(self.materials) - 1

    def texture(self, name: str, kind: str, content: bytes) -> int:
        """Add a texture of a picture file's bytes; kind: its MIME type. Returns its index."""
        self.images.append({"name": name, "mimeType": kind, "bufferView": self.content(content)})
        self.textures.append({"source": len(self.images) - 1})
        return len(self.textures) - 1

    def write(self, path: Path) -> None:
        """Write the file. Raises InputError if it would exceed the 4 GiB that the format can hold."""
        document: dict[str, Any] = {
            **self.others,
            "asset": {**self.others.get("asset", {}), "version": "2.0", "generator": "uvcloth"},
            "scene": 0,
            "scenes": [{"nodes": self.roots}],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": self.materials,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": self.length}],
        }
        if self.images:
            document |= {"images": self.images, "textures": self.textures}
        motion = {"name": path.stem, "samplers": self.samplers, "channels": self.channels}
        if animations := [*([motion] if self.channels else []), *self.animations]:
            document["animations"] = animations
        if self.skins:
            document["skins"] = self.skins
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + self.length
        if total > MAX_FILE_BYTES:
            raise InputError(
                f"{path.name}: {total / 2**30:.1f} GiB do not fit into a .glb (at most 4 GiB), "
                "write fewer frames or blend shapes, or another format"
            )
        with path.open("wb") as stream:
            stream.write(struct.pack("<4sII", b"glTF", 2, total))
            stream.write(struct.pack("<I4s", len(text), b"JSON") + text)
            stream.write(struct.pack("<I4s", self.length, b"BIN\0"))
            for part in self.parts:
                for data in part():
                    stream.write(np.ascontiguousarray(data).data)
