"""glTF 2.0 files, and FBX files as such: with buffers in files beside them."""

import base64
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

from uvcloth.errors import InputError
from uvcloth.files.reading import file_below, read_content
from uvcloth.formats.fbx import FBX, glb_from_fbx
from uvcloth.player.gltf_document import parents_of
from uvcloth.player.gltf_file import GltfFile, parse_glb

SCENES = (".glb", ".gltf", ".vrm", FBX)
"""Suffixes of the files that `read_gltf` reads."""

MOST_MESHES = 2000
"""Meshes, each of one material, that the nodes of a scene may place."""


@dataclass(frozen=True)
class Gltf(GltfFile):
    """A glTF file of a user, with the files beside it that it names; all errors are InputErrors."""

    def content(self, uri: str) -> bytes:
        """Bytes of a data URI or of a file beside this one."""
        if uri.startswith("data:"):
            return decode_data(uri)
        folder = self.path.parent
        try:
            return read_content(file_below(folder, folder, unquote(uri)))
        except InputError as error:
            raise self.error(f"its buffer {error}") from error

    def error(self, sentence: str) -> InputError:
        """See GltfFile."""
        return InputError(f"{self.path}: {sentence}")


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
    """Read a file of SCENES. Raises InputError naming the file, and the place, if it is not valid."""
    path = Path(path)
    content = glb_from_fbx(path) if path.suffix.lower() == FBX else read_content(path)
    try:
        document, binary = parse_glb(content)
        return Gltf(path, document, binary, parents_of(document))
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
