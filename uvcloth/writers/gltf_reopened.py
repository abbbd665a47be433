"""Documents that continue a glTF file: all that it has stays, with the indices that it has."""

import copy
import logging
from collections.abc import Callable, Collection, Iterator

import numpy as np

from uvcloth.errors import InputError
from uvcloth.player.gltf_file import GltfFile
from uvcloth.writers.glb import Document

LOGGER = logging.getLogger(__name__)

KINDS = {b"\x89PNG": "image/png", b"\xff\xd8": "image/jpeg"}
"""MIME types of pictures by their first bytes."""


def reopened(file: GltfFile, without: Collection[int] = ()) -> Document:
    """Document of a file's scene, nodes, meshes, materials, skins and animations, its buffers made one.

    without: buffer views of which only zeros stay. Pictures that lie beside the file come along; of one that
    is missing the log says so. Raises InputError naming the file if bytes of a buffer are missing.
    """
    entries = copy.deepcopy(file.document)
    document = Document()
    for index, view in enumerate(entries.pop("bufferViews", [])):
        try:
            content = memoryview(bytes(4)) if index in without else file.view(index)
        except ValueError as error:
            raise InputError(str(error)) from error
        document.view(len(content) + -len(content) % 4, _bytes_of(content))
        kept = {key: view[key] for key in view if key not in ("buffer", "byteOffset", "byteLength")}
        document.views[-1] |= {**kept, "byteLength": len(content)}
    roots = [index for index in range(len(entries.get("nodes", []))) if index not in file.above]
    scenes = entries.pop("scenes", [])
    document.roots = scenes[entries.get("scene", 0)].get("nodes", []) if scenes else roots
    for name in ("accessors", "nodes", "meshes", "materials", "textures", "images", "skins", "animations"):
        setattr(document, name, entries.pop(name, []))
    for name in ("buffers", "scene"):
        entries.pop(name, None)
    document.others = entries
    _embed_pictures(document, file)
    return document


def _bytes_of(content: memoryview) -> Callable[[], Iterator[np.ndarray]]:
    """A part of a document that yields bytes, filled up to a multiple of four."""
    return lambda: iter([np.frombuffer(content, np.uint8), np.zeros(-len(content) % 4, np.uint8)])


def _embed_pictures(document: Document, file: GltfFile) -> None:
    for image in document.images:
        uri = image.get("uri", "data:")
        if uri.startswith("data:"):
            continue
        try:
            content = file.content(uri)
        except ValueError as error:
            LOGGER.warning("%s", error)
            continue
        kind = next((kind for start, kind in KINDS.items() if content.startswith(start)), None)
        if kind is not None:
            del image["uri"]
            image |= {"mimeType": kind, "bufferView": document.content(content)}
