"""Meshes of glTF files of users: all triangles of the scene, as their nodes place them."""

import base64
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import torch

from uvcloth.garments.materials import read_texture
from uvcloth.geometry.authored import AuthoredMesh, Labels, Polygons, SurfaceMaterial, Texture, UvSet
from uvcloth.geometry.gltf import Gltf, read_gltf

SUFFIXES = {"image/png": ".png", "image/jpeg": ".jpg"}

TRIANGLES = 4
"""The mode of primitives that are triangles."""


@dataclass(frozen=True)
class _Part:
    """Vertices of one set of attributes, as a node places them.

    uvs: (N, 2) of each set. colors: (N, 4) or None. faces: (F, 3). material: (F,). name: of the node.
    """

    vertices: np.ndarray
    uvs: tuple[np.ndarray, ...]
    colors: np.ndarray | None
    faces: np.ndarray
    material: np.ndarray
    name: str


def read_gltf_mesh(path: Path) -> AuthoredMesh:
    """Read the triangles of a .glb or .gltf, its vertices float64, in the order of nodes and accessors.

    Raises InputError for a file that is none or lacks data, and what broken JSON makes a reader trip over.
    """
    gltf = read_gltf(path)
    parts = [part for node, place in _placed(gltf) for part in _parts(gltf, node, place)]
    counts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    if not parts:
        parts = [_Part(np.zeros((0, 3)), (), None, np.zeros((0, 3), int), np.zeros(0, int), "")]
    faces = np.concatenate([part.faces + start for part, start in zip(parts, counts, strict=False)])
    names = tuple(dict.fromkeys(part.name for part in parts))
    sets = min(len(part.uvs) for part in parts)
    colored = all(part.colors is not None for part in parts)
    corners = faces.reshape(-1).astype(np.int64)
    materials, missing = _materials(gltf)
    polygons = Polygons(
        sizes=np.full(len(faces), 3),
        corners=corners,
        uv_sets=tuple(
            UvSet(np.concatenate([part.uvs[index] for part in parts]).astype(np.float32), corners)
            for index in range(sets)
        ),
        objects=Labels(names, np.concatenate([np.full(len(p.faces), names.index(p.name)) for p in parts])),
        groups=Labels((), np.full(len(faces), -1)),
        materials=materials,
        material=np.concatenate([part.material for part in parts]),
        colors=np.concatenate([part.colors for part in parts]) if colored else None,
        missing=missing,
    )
    return AuthoredMesh.of(torch.from_numpy(np.concatenate([part.vertices for part in parts])), polygons)


def _placed(gltf: Gltf) -> list[tuple[dict[str, Any], np.ndarray]]:
    """Nodes of the scene with their transforms (4, 4), parents first."""
    nodes, scenes = gltf.entries("nodes"), gltf.entries("scenes")
    children = {child for node in nodes for child in node.get("children", [])}
    roots = [index for index in range(len(nodes)) if index not in children]
    if scenes:
        roots = scenes[gltf.document.get("scene", 0)].get("nodes", [])
    found: list[tuple[dict[str, Any], np.ndarray]] = []
    waiting = [(root, np.eye(4)) for root in reversed(roots)]
    while waiting and len(found) <= len(nodes):
        index, above = waiting.pop()
        place = above @ _local(nodes[index])
        found.append((nodes[index], place))
        waiting.extend((child, place) for child in reversed(nodes[index].get("children", [])))
    return found


def _local(node: dict[str, Any]) -> np.ndarray:
    """Transform (4, 4) of a node in its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    place = np.eye(4)
    place[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    place[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return place


def _parts(gltf: Gltf, node: dict[str, Any], place: np.ndarray) -> list[_Part]:
    """The triangles of a node's mesh; primitives that share their attributes share their vertices."""
    if "mesh" not in node:
        return []
    mesh = gltf.entries("meshes")[node["mesh"]]
    name = str(node.get("name", mesh.get("name", "")))
    shared: dict[tuple[tuple[str, int], ...], list[dict[str, Any]]] = {}
    for primitive in mesh["primitives"]:
        if primitive.get("mode", TRIANGLES) == TRIANGLES:
            shared.setdefault(tuple(sorted(primitive["attributes"].items())), []).append(primitive)
    parts = []
    for attributes, primitives in shared.items():
        of = dict(attributes)
        positions = gltf.array(of["POSITION"]).astype(np.float64)
        faces = [_faces(gltf, primitive, len(positions)) for primitive in primitives]
        uvs: list[np.ndarray] = []
        while (key := f"TEXCOORD_{len(uvs)}") in of:
            # glTF measures the second coordinate from the top of the picture.
            uvs.append(gltf.array(of[key]) * [1, -1] + [0, 1])
        parts.append(
            _Part(
                vertices=positions @ place[:3, :3].T + place[:3, 3],
                uvs=tuple(uvs),
                colors=_colors(gltf.array(of["COLOR_0"])) if "COLOR_0" in of else None,
                faces=np.concatenate(faces),
                material=np.repeat([p.get("material", -1) for p in primitives], [len(f) for f in faces]),
                name=name,
            )
        )
    return parts


def _faces(gltf: Gltf, primitive: dict[str, Any], count: int) -> np.ndarray:
    """Faces (F, 3) of a primitive. Raises ValueError if they name a vertex that it does not have."""
    indices = gltf.array(primitive["indices"]).reshape(-1) if "indices" in primitive else np.arange(count)
    faces = indices[: len(indices) // 3 * 3].astype(np.int64).reshape(-1, 3)
    if faces.size and faces.max() >= count:
        raise ValueError(f"a face names vertex {faces.max()} of {count}")
    return faces


def _colors(values: np.ndarray) -> np.ndarray:
    """Colours (N, 4) of three or four linear channels, as sRGB."""
    rgba = np.concatenate([values[:, :3] ** (1 / 2.2), np.ones_like(values[:, :1])], axis=1)
    rgba[:, 3:] = values[:, 3:] if values.shape[1] > 3 else 1.0
    return rgba.astype(np.float32)


def _materials(gltf: Gltf) -> tuple[tuple[SurfaceMaterial, ...], tuple[str, ...]]:
    """Materials of a file, and the pictures that are missing."""
    found, missing = [], []
    for index, entry in enumerate(gltf.entries("materials")):
        rough = entry.get("pbrMetallicRoughness", {})
        red, green, blue, alpha = rough.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
        texture, uv_set = None, 0
        if "baseColorTexture" in rough:
            uv_set = rough["baseColorTexture"].get("texCoord", 0)
            source = gltf.entries("textures")[rough["baseColorTexture"]["index"]].get("source")
            texture = None if source is None else _texture(gltf, source)
            if texture is None:
                missing.append(f"the picture of material {entry.get('name', index)}")
        color = (red ** (1 / 2.2), green ** (1 / 2.2), blue ** (1 / 2.2), alpha)
        found.append(SurfaceMaterial(str(entry.get("name", f"material_{index}")), color, texture, uv_set))
    return tuple(found), tuple(missing)


def _texture(gltf: Gltf, index: int) -> Texture | None:
    """An image of a file, None if it is not there or of another kind than PNG and JPEG."""
    image = gltf.entries("images")[index]
    uri = str(image.get("uri", ""))
    name = str(image.get("name", f"texture_{index}"))
    if uri and not uri.startswith("data:"):
        return read_texture(gltf.path.parent / unquote(uri))
    head, _, data = uri.partition(",")
    suffix = SUFFIXES.get(image.get("mimeType", head[5:].partition(";")[0]))
    if suffix is None:
        return None
    content = base64.b64decode(data) if uri else gltf.view(image["bufferView"])
    return Texture(Path(name).stem, suffix, content)
