"""Clothes of a character as garments of their own: at rest on the body made of it, with their textures."""

import re
from collections.abc import Mapping
from pathlib import Path

import torch

from uvcloth.characters.look import polygons_of_parts
from uvcloth.characters.parts import Sorted, is_clothing
from uvcloth.characters.reader import Part
from uvcloth.formats.gltf_mesh import read_materials
from uvcloth.geometry.authored import AuthoredMesh, SurfaceMaterial, UvSet
from uvcloth.geometry.mesh import join_meshes, weld

NOT_NAME = re.compile(r"[^0-9A-Za-z]+")


def clothes_of(path: Path, parts: Sorted) -> Mapping[str, AuthoredMesh]:
    """The clothes among the sorted parts of the character in a glTF file, by name, at rest: metres, Z up.

    Parts are clothes by the words in their names, or because they were to be left out. Materials of one mesh
    that is named as a garment are one garment, those of any other mesh one each; a character without clothes
    has none. Raises InputError for a file that cannot be read.
    """
    groups: dict[str, list[Part]] = {}
    for part in (*filter(is_clothing, parts.surface), *parts.left_out):
        groups.setdefault(_name(part), []).append(part)
    materials = {material.name: material for material in read_materials(path)[0]}
    return {name: _garment(name, group, materials) for name, group in groups.items()}


def is_worn_as_skin(parts: Sorted) -> bool:
    """True if clothes stand in for skin that the character does not have."""
    return any(is_clothing(part) for part in parts.surface)


def _name(part: Part) -> str:
    """Name of the garment that a part belongs to, of letters, digits and underscores."""
    whole = is_clothing(Part(part.name, "", part.mesh, part.weights))
    return NOT_NAME.sub("_", part.name if whole else part.material or part.name).strip("_") or "garment"


def _garment(name: str, parts: list[Part], materials: dict[str, SurfaceMaterial]) -> AuthoredMesh:
    """One mesh of all parts, their vertices joined where they are at one place."""
    joined = join_meshes((part.mesh.vertices, part.mesh.faces) for part in parts)
    kept, faces = weld(joined.vertices)[joined.faces].unique(return_inverse=True)
    uv_sets: tuple[UvSet, ...] = ()
    if all(len(part.mesh.uvs) for part in parts):
        textured = join_meshes((part.mesh.uvs, part.mesh.face_uvs) for part in parts)
        uv_sets = (UvSet(textured.vertices.numpy(), textured.faces.numpy().reshape(-1)),)
    polygons = polygons_of_parts(name, parts, faces.numpy(), uv_sets, materials)
    return AuthoredMesh.of(joined.vertices[kept].to(torch.float32), polygons)
