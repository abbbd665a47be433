"""SurfaceMaterial files of users: Wavefront .mtl and MakeHuman's .mhmat, and the pictures that they name."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from rasterize.errors import InputError
from uvcloth.geometry.authored import SurfaceMaterial, Texture

OPTIONS = {"-s": 3, "-o": 3, "-t": 3, "-mm": 2}
"""Numbers that follow an option of map_Kd; after any other there is one."""


def read_text(path: Path) -> list[str]:
    """Read the lines of a text file, those that end in a backslash joined with the next.

    Raises InputError if there is no such file or it cannot be read.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    return text.replace("\\\n", " ").splitlines()


def read_library(path: Path) -> tuple[dict[str, SurfaceMaterial], tuple[str, ...]]:
    """Read the materials of an .mtl by name, and which files are not there, the .mtl itself among them."""
    if not path.is_file():
        return {}, (path.name,)
    materials: dict[str, SurfaceMaterial] = {}
    missing: list[str] = []
    name = ""
    for words in _words(path):
        if words[0] == "newmtl":
            name = " ".join(words[1:])
            materials[name] = SurfaceMaterial(name)
        elif name in materials:
            materials[name] = _with(materials[name], words, path.parent, missing)
    return materials, tuple(missing)


def read_mhmat(path: Path) -> tuple[SurfaceMaterial, tuple[str, ...]]:
    """Read a material of MakeHuman, and which files are not there; a plain one if it is not itself."""
    material = SurfaceMaterial(path.stem)
    if not path.is_file():
        return material, (path.name,)
    missing: list[str] = []
    keys = {"diffuseColor": "Kd", "opacity": "d", "diffuseTexture": "map_Kd"}
    for words in _words(path):
        if words[0] == "name" and words[1:]:
            material = replace(material, name=" ".join(words[1:]))
        elif words[0] in keys:
            material = _with(material, [keys[words[0]], *words[1:]], path.parent, missing)
    return material, tuple(missing)


def _words(path: Path) -> Iterator[list[str]]:
    """The words of each line that has any, comments left out."""
    for line in read_text(path):
        words = line.split()
        if words and not words[0].startswith(("#", "//")):
            yield words


def _with(material: SurfaceMaterial, words: list[str], folder: Path, missing: list[str]) -> SurfaceMaterial:
    """The material with what a line says; a picture that is not there is added to `missing`."""
    try:
        match words:
            case ["Kd", red, green, blue, *_]:
                return replace(material, color=(float(red), float(green), float(blue), material.color[3]))
            case ["d", opacity]:
                return replace(material, color=(*material.color[:3], float(opacity)))
            case ["Tr", transparency]:
                return replace(material, color=(*material.color[:3], 1.0 - float(transparency)))
            case ["map_Kd", *rest]:
                name = " ".join(_after_options(rest)).replace("\\", "/")
                texture = read_texture(folder / name)
                if texture is None:
                    missing.append(name)
                return replace(material, texture=texture)
    except ValueError:
        # A material is no reason to refuse a garment.
        return material
    return material


def _after_options(words: list[str]) -> list[str]:
    while words and words[0].startswith("-"):
        words = words[1 + OPTIONS.get(words[0], 1) :]
    return words


def read_texture(path: Path) -> Texture | None:
    """Read a picture file as it is, None if it is not there."""
    try:
        return Texture(path.stem, path.suffix.lower(), path.read_bytes())
    except OSError:
        return None
