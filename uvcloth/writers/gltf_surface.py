"""Surfaces of garments in glTF: a primitive per material, all UV sets, vertex colours and textures."""

from typing import Any

import numpy as np

from uvcloth.geometry.authored import SurfaceMaterial, polygons_of
from uvcloth.geometry.mesh import Mesh
from uvcloth.rendering.render import Color
from uvcloth.writers.glb import FLOAT, INDICES, VERTICES, Document, index_type
from uvcloth.writers.gltf_scene import TO_Y_UP, split_corners, unit_normals

MIME_TYPES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
"""Kinds of pictures that every glTF reader knows."""


def add_surface(
    document: Document, name: str, mesh: Mesh, color: Color
) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """Add a garment at rest, its polygons as triangles; color: where no material gives one.

    Returns the source vertex of each glTF vertex (M,), and a primitive for each material.
    """
    polygons = polygons_of(mesh)
    count = len(mesh.vertices)
    sets = polygons.uv_sets
    source, place, rows, keys = split_corners(count, polygons.corners, [each.corners for each in sets])
    rest = mesh.vertices.numpy()
    attributes = {
        "POSITION": document.array(rest[source] @ TO_Y_UP.T, "VEC3", FLOAT, VERTICES, bounds=True),
        "NORMAL": document.array(unit_normals(rest, mesh)[source] @ TO_Y_UP.T, "VEC3", FLOAT, VERTICES),
    }
    for index, each in enumerate(sets):
        uvs = np.zeros((len(source), 2), np.float32)
        uvs[rows] = each.uvs[keys[:, index]]
        # glTF measures the second coordinate from the top of the picture.
        turned = uvs * [1, -1] + [0, 1]
        attributes[f"TEXCOORD_{index}"] = document.array(turned, "VEC2", FLOAT, VERTICES)
    if polygons.colors is not None:
        linear = np.concatenate([polygons.colors[:, :3] ** 2.2, polygons.colors[:, 3:]], axis=1)
        attributes["COLOR_0"] = document.array(linear[source], "VEC4", FLOAT, VERTICES)
        color = (1.0, 1.0, 1.0)
    corners, owner = polygons.triangles()
    primitives = []
    for index in np.unique(polygons.material):
        faces = place[corners[polygons.material[owner] == index]]
        if not len(faces):
            continue
        material = (
            document.material(name, color)
            if index < 0
            else _add_material(document, polygons.materials[index])
        )
        indices = document.array(faces.reshape(-1), "SCALAR", index_type(len(source)), INDICES)
        primitives.append({"attributes": attributes, "indices": indices, "material": material})
    return source, primitives


def _add_material(document: Document, material: SurfaceMaterial) -> int:
    red, green, blue, opacity = material.color
    picture, texture = material.texture, None
    if picture and picture.suffix in MIME_TYPES:
        index = document.texture(picture.name, MIME_TYPES[picture.suffix], picture.content)
        texture = {"index": index, "texCoord": material.uv_set}
    return document.material(material.name, (red, green, blue), opacity, texture)
