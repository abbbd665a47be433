"""Materials and textures of a character's visible meshes, as arrays of the body's file."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from uvcloth.errors import InputError
from uvcloth.files.fields import check_fields, indices, names, numbers, whole
from uvcloth.geometry.authored import AuthoredMesh, SurfaceMaterial, Texture, polygons_of
from uvcloth.geometry.mesh import Mesh

FIELDS = {
    "look_of": indices("F", of="M", least=-1),
    "look_names": names("M"),
    "look_colors": numbers("M", 4, least=0.0, most=1.0),
    "look_textures": indices("M", of="T", least=-1),
    "texture_names": names("T"),
    "texture_sizes": whole("T"),
    "texture_bytes": whole("B", most=255, dtype=np.uint8).or_empty(),
}
"""M materials and T textures. look_of: material of each face, -1 for none. texture_sizes: bytes of each."""


def material_arrays(mesh: Mesh) -> dict[str, np.ndarray]:
    """The materials of a mesh of triangles as arrays, none where it has no materials."""
    polygons = polygons_of(mesh)
    if not polygons.materials:
        return {}
    pictures = [material.texture for material in polygons.materials]
    # A texture is stored once, however many materials have it.
    textures = list(dict.fromkeys(picture for picture in pictures if picture))
    content = b"".join(texture.content for texture in textures)
    return {
        "look_of": polygons.material.astype(np.int32),
        "look_names": np.array([material.name for material in polygons.materials], dtype=np.str_),
        "look_colors": np.array([material.color for material in polygons.materials], np.float32),
        "look_textures": np.array([textures.index(each) if each else -1 for each in pictures], np.int32),
        "texture_names": np.array([texture.name + texture.suffix for texture in textures], dtype=np.str_),
        "texture_sizes": np.array([len(texture.content) for texture in textures], np.int64),
        "texture_bytes": np.frombuffer(content, np.uint8),
    }


def with_materials(path: Path, arrays: dict[str, np.ndarray], mesh: Mesh) -> Mesh:
    """The mesh of a body's file with the materials there, as it is without them.

    Raises InputError naming the file, and the array, for arrays that do not fit together.
    """
    if "look_of" not in arrays:
        return mesh
    data = check_fields(path, arrays, FIELDS, F=len(mesh.faces))
    ends = np.cumsum(data["texture_sizes"])
    if (ends[-1] if len(ends) else 0) != len(data["texture_bytes"]):
        raise InputError(
            f"{path}: texture_bytes holds {len(data['texture_bytes'])} bytes, not texture_sizes'"
        )
    textures = [
        Texture(Path(str(name)).stem, Path(str(name)).suffix, content.tobytes())
        for name, content in zip(
            data["texture_names"], np.split(data["texture_bytes"], ends[:-1]), strict=False
        )
    ]
    materials = tuple(
        SurfaceMaterial(str(name), tuple(color.tolist()), textures[picture] if picture >= 0 else None)
        for name, color, picture in zip(
            data["look_names"], data["look_colors"], data["look_textures"], strict=True
        )
    )
    polygons = replace(polygons_of(mesh), materials=materials, material=data["look_of"])
    return AuthoredMesh(mesh.vertices, mesh.faces, mesh.uvs, mesh.face_uvs, polygons)
