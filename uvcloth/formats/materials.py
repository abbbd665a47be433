"""Material files of users: Wavefront .mtl and MakeHuman's .mhmat, and the pictures that they name."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from uvcloth.errors import InputError
from uvcloth.files.reading import file_below, read_content
from uvcloth.geometry.authored import SurfaceMaterial, Texture

OPTIONS = {"-s": 3, "-o": 3, "-t": 3, "-mm": 2}
"""Numbers that follow an option of map_Kd; after any other there is one."""


def read_text(path: Path) -> list[str]:
    """Read the lines of a text file, those that end in a backslash joined with the next.

    Raises InputError if there is no such file or it cannot be read.
    """
    text = read_content(path).decode("utf-8-sig", errors="replace").replace("\r\n", "\n")
    return text.replace("\\\n", " ").splitlines()


class TextureFiles:
    """Picture files that materials name, each read once: in the folder `root` or below, and nowhere else.

    missing: pictures and material files that do not exist, or lie elsewhere.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.missing: list[str] = []
        self._read: dict[Path, Texture] = {}

    def file(self, folder: Path, name: str) -> Path | None:
        """A file that another one in `folder` names, None if it is missing."""
        try:
            path = file_below(self.root, folder, name)
            if path.is_file():
                return path
            self.missing.append(name)
        except InputError as error:
            self.missing.append(str(error))
        except OSError:
            self.missing.append(name)
        return None

    def texture(self, folder: Path, name: str) -> Texture | None:
        """A picture as it is, None if it is missing."""
        path = self.file(folder, name)
        if path is not None and path not in self._read:
            try:
                self._read[path] = Texture(path.stem, path.suffix.lower(), read_content(path))
            except InputError:
                self.missing.append(name)
        return None if path is None else self._read.get(path)


def read_libraries(pictures: TextureFiles, names: Iterable[str]) -> dict[str, SurfaceMaterial]:
    """Read the materials of .mtl files in the root of the pictures, by name; missing files are left out."""
    paths = [pictures.file(pictures.root, name) for name in dict.fromkeys(names)]
    materials: dict[str, SurfaceMaterial] = {}
    for path in filter(None, paths):
        current: str | None = None
        for words in _words(path):
            if words[0] == "newmtl":
                current = " ".join(words[1:])
                materials[current] = SurfaceMaterial(current)
            elif current is not None:
                materials[current] = _with(materials[current], words, path.parent, pictures)
    return materials


def read_mhmat(pictures: TextureFiles, name: str) -> SurfaceMaterial | None:
    """Read a material of MakeHuman in the root of the pictures, None if it is missing."""
    path = pictures.file(pictures.root, name)
    if path is None:
        return None
    material = SurfaceMaterial(path.stem)
    keys = {"diffuseColor": "Kd", "opacity": "d", "diffuseTexture": "map_Kd"}
    for words in _words(path):
        if words[0] == "name" and words[1:]:
            material = replace(material, name=" ".join(words[1:]))
        elif words[0] in keys:
            material = _with(material, [keys[words[0]], *words[1:]], path.parent, pictures)
    return material


def _words(path: Path) -> Iterator[list[str]]:
    """The words of each line that has any, comments left out."""
    for line in read_text(path):
        words = line.split()
        if words and not words[0].startswith(("#", "//")):
            yield words


def _with(
    material: SurfaceMaterial, words: list[str], folder: Path, pictures: TextureFiles
) -> SurfaceMaterial:
    """The material, changed by a line of a file in `folder`."""
    try:
        match words:
            case ["Kd", red, green, blue, *_]:
                return replace(material, color=(_share(red), _share(green), _share(blue), material.color[3]))
            case ["d", opacity]:
                return replace(material, color=(*material.color[:3], _share(opacity)))
            case ["Tr", transparency]:
                return replace(material, color=(*material.color[:3], 1.0 - _share(transparency)))
            case ["map_Kd", *rest]:
                name = " ".join(_after_options(rest)).replace("\\", "/")
                return replace(material, texture=pictures.texture(folder, name))
    except ValueError:
        # A material is no reason to refuse a garment.
        return material
    return material


def _after_options(words: list[str]) -> list[str]:
    while words and words[0].startswith("-"):
        words = words[1 + OPTIONS.get(words[0], 1) :]
    return words


def _share(word: str) -> float:
    """A number clamped to 0 to 1. Raises ValueError for a word that is not a finite number."""
    value = float(word)
    if not math.isfinite(value):
        raise ValueError(word)
    return min(max(value, 0.0), 1.0)
