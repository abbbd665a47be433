"""Meshes of glTF files of users: all triangles of the scene, as their nodes place them."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import torch

from uvcloth.errors import InputError
from uvcloth.formats.gltf import Gltf, decode_data, read_gltf, require_few
from uvcloth.formats.gltf_rig import read_rig
from uvcloth.formats.materials import TextureFiles
from uvcloth.formats.size import refuse_too_many
from uvcloth.geometry.authored import AuthoredMesh, Labels, Polygons, SurfaceMaterial, Texture, UvSet
from uvcloth.player.gltf_file import one_line
from uvcloth.player.nodes import local_transform

SUFFIXES = {"image/png": ".png", "image/jpeg": ".jpg"}

KTX2 = "KHR_texture_basisu"
"""Extension of textures that are KTX2 files."""

UNREAD = "textures in KTX2, which is not read: `gltf-transform ktxdecompress` converts them to PNG"
"""What a person is told of them."""

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

    Raises InputError for a file that is not valid, lacks data, or has too many vertices or faces.
    """
    gltf = read_gltf(path)
    parts: list[_Part] = []
    vertices, faces_so_far = 0, 0
    for node, place in _placed(gltf):
        for part in _parts(gltf, node, place):
            parts.append(part)
            require_few(path, len(parts))
            vertices, faces_so_far = vertices + len(part.vertices), faces_so_far + len(part.faces)
            refuse_too_many(path, vertices, faces_so_far)
    counts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    if not parts:
        parts = [_Part(np.zeros((0, 3)), (), None, np.zeros((0, 3), int), np.zeros(0, int), "")]
    faces = np.concatenate([part.faces + start for part, start in zip(parts, counts, strict=False)])
    names = tuple(dict.fromkeys(part.name for part in parts))
    sets = min(len(part.uvs) for part in parts)
    colored = all(part.colors is not None for part in parts)
    corners = faces.reshape(-1).astype(np.int64)
    materials, missing = _materials(gltf, sets)
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


def read_materials(path: Path) -> tuple[tuple[SurfaceMaterial, ...], tuple[str, ...]]:
    """Read the materials of a .glb, .gltf or .vrm, with textures on the first set of texture coordinates.

    Returns also names of the pictures that are missing or not read. Raises InputError for a file that is not
    valid.
    """
    return _materials(read_gltf(path), 1)


def _placed(gltf: Gltf) -> list[tuple[dict[str, Any], np.ndarray]]:
    """Nodes of the scene with the transforms (4, 4) of their meshes, parents first."""
    nodes, scenes = gltf.entries("nodes"), gltf.entries("scenes")
    roots = [index for index in range(len(nodes)) if index not in gltf.above]
    if scenes:
        roots = scenes[gltf.document.get("scene", 0)].get("nodes", [])
    order: list[tuple[dict[str, Any], np.ndarray]] = []
    waiting = [(root, np.eye(4)) for root in reversed(roots)]
    while waiting and len(order) <= len(nodes):
        index, above = waiting.pop()
        place = above @ local_transform(nodes[index])
        order.append((nodes[index], place))
        waiting.extend((child, place) for child in reversed(nodes[index].get("children", [])))
    # Joints place a skinned mesh, wherever its own node is.
    skins = {node["skin"] for node, _ in order if "mesh" in node and "skin" in node}
    placing = {skin: read_rig(gltf, gltf.entries("skins")[skin]).placing for skin in skins}
    return [(node, placing.get(node.get("skin"), place)) for node, place in order]


def _parts(gltf: Gltf, node: dict[str, Any], place: np.ndarray) -> Iterator[_Part]:
    """The triangles of a node's mesh; primitives that share their attributes share their vertices."""
    if "mesh" not in node:
        return
    mesh = gltf.entries("meshes")[node["mesh"]]
    name = one_line(node.get("name", mesh.get("name", "")))
    shared: dict[tuple[tuple[str, int], ...], list[dict[str, Any]]] = {}
    for primitive in mesh["primitives"]:
        if primitive.get("mode", TRIANGLES) == TRIANGLES:
            shared.setdefault(tuple(sorted(primitive["attributes"].items())), []).append(primitive)
    for attributes, primitives in shared.items():
        of = dict(attributes)
        if "POSITION" not in of:
            raise InputError(f"{gltf.path}: mesh {name} has no positions")
        positions = gltf.array(of["POSITION"], "VEC3").astype(np.float64)
        refuse_too_many(gltf.path, len(positions), sum(_corners(gltf, each) for each in primitives) // 3)
        faces = [_faces(gltf, primitive, len(positions)) for primitive in primitives]
        uvs: list[np.ndarray] = []
        while (key := f"TEXCOORD_{len(uvs)}") in of:
            # glTF measures the second coordinate from the top of the picture.
            uvs.append(gltf.array(of[key], "VEC2") * [1, -1] + [0, 1])
        colors = _colors(gltf.array(of["COLOR_0"], "VEC3", "VEC4")) if "COLOR_0" in of else None
        if any(len(each) != len(positions) for each in (*uvs, *(() if colors is None else (colors,)))):
            raise InputError(
                f"{gltf.path}: mesh {name} has attributes whose count differs from that of its vertices"
            )
        yield _Part(
            vertices=positions @ place[:3, :3].T + place[:3, 3],
            uvs=tuple(uvs),
            colors=colors,
            faces=np.concatenate(faces),
            material=np.repeat([p.get("material", -1) for p in primitives], [len(f) for f in faces]),
            name=name,
        )


def _corners(gltf: Gltf, primitive: dict[str, Any]) -> int:
    """Number of corners that a primitive states."""
    accessor = primitive.get("indices", primitive["attributes"]["POSITION"])
    return int(gltf.entries("accessors")[accessor]["count"])


def _faces(gltf: Gltf, primitive: dict[str, Any], count: int) -> np.ndarray:
    """Faces (F, 3) of a primitive. Raises InputError if they refer to a vertex that it does not have."""
    indices = gltf.array(primitive["indices"], "SCALAR")[:, 0] if "indices" in primitive else np.arange(count)
    faces = indices[: len(indices) // 3 * 3].astype(np.int64).reshape(-1, 3)
    if faces.size and not 0 <= faces.min() <= faces.max() < count:
        raise InputError(f"{gltf.path}: a face refers to a vertex beyond the {count} of its mesh")
    return faces


def _colors(values: np.ndarray) -> np.ndarray:
    """Colours (N, 4) of three or four linear channels, as sRGB."""
    values = values.clip(0.0, 1.0)
    rgba = np.concatenate([values[:, :3] ** (1 / 2.2), np.ones_like(values[:, :1])], axis=1)
    rgba[:, 3:] = values[:, 3:] if values.shape[1] > 3 else 1.0
    return rgba.astype(np.float32)


def _materials(gltf: Gltf, sets: int) -> tuple[tuple[SurfaceMaterial, ...], tuple[str, ...]]:
    """Materials of a file with `sets` sets of texture coordinates, and the pictures that are missing."""
    materials, missing = [], []
    pictures = TextureFiles(gltf.path.parent)
    textures: dict[int, Texture | None] = {}
    for index, entry in enumerate(gltf.entries("materials")):
        rough = entry.get("pbrMetallicRoughness", {})
        factor = rough.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
        red, green, blue, alpha = (min(max(channel, 0.0), 1.0) for channel in factor)
        texture, uv_set = None, 0
        if "baseColorTexture" in rough:
            uv_set = rough["baseColorTexture"].get("texCoord", 0)
            picture = gltf.entries("textures")[rough["baseColorTexture"]["index"]]
            source = picture.get("source")
            if source is not None and source not in textures:
                textures[source] = _texture(gltf, pictures, source)
            texture = textures[source] if source is not None and uv_set < sets else None
            if source is None and KTX2 in picture.get("extensions", {}):
                missing.append(UNREAD)
            elif texture is None:
                missing.append(f"the picture of material {one_line(entry.get('name', index))}")
        color = (red ** (1 / 2.2), green ** (1 / 2.2), blue ** (1 / 2.2), alpha)
        label = one_line(entry.get("name", f"material_{index}"))
        materials.append(SurfaceMaterial(label, color, texture, uv_set))
    return tuple(materials), (*missing, *pictures.missing)


def _texture(gltf: Gltf, pictures: TextureFiles, index: int) -> Texture | None:
    """An image of a file, None if it is not there or of another kind than PNG and JPEG."""
    image = gltf.entries("images")[index]
    uri = image.get("uri", "")
    name = one_line(image.get("name", f"texture_{index}"))
    if uri and not uri.startswith("data:"):
        return pictures.texture(gltf.path.parent, unquote(uri))
    suffix = SUFFIXES.get(image.get("mimeType", uri[5:].partition(",")[0].partition(";")[0]))
    if suffix is None or not (uri or "bufferView" in image):
        return None
    content = decode_data(uri) if uri else bytes(gltf.view(image["bufferView"]))
    return Texture(Path(name).stem, suffix, content)
