"""Played files: the character of a baked file in one animation, its garments as a morph target per frame.

NumPy is enough for it, so that playing starts at once.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from uvcloth.player.animation import sampled_channel
from uvcloth.player.baked import EXTENSION, BakedFile, BakedGarment, JointMotion
from uvcloth.player.gltf_file import GltfFile
from uvcloth.player.nodes import REST
from uvcloth.writers.glb import Document
from uvcloth.writers.gltf_reopened import reopened
from uvcloth.writers.gltf_targets import add_frames, target_names

FRAMES_AT_ONCE = 32
"""Frames that are computed at once."""

BINDING = ("JOINTS_", "WEIGHTS_")
"""Beginnings of the attributes that bind a mesh to joints."""


def played_document(baked: BakedFile, motion: JointMotion) -> tuple[Document, int]:
    """Document of a baked file without its cloth, in one animation: the file's own, or one that is empty.

    Returns also the accessor of the times of the frames.
    """
    document = reopened(baked.file, without=(baked.view,))
    extensions, used = (document.others.pop(key, {}) for key in ("extensions", "extensionsUsed"))
    if left := {name: extensions[name] for name in extensions if name != EXTENSION}:
        document.others["extensions"] = left
    if names := [name for name in used if name != EXTENSION]:
        document.others["extensionsUsed"] = names
    document.animations = []
    time = document.array(motion.times - motion.times[0], "SCALAR", bounds=True)
    for channel in () if motion.animation is None else motion.animation["channels"]:
        _keep(document, baked.file, motion, channel, time)
    return document, time


def _keep(
    document: Document, file: GltfFile, motion: JointMotion, channel: dict[str, Any], time: int
) -> None:
    """Keep a channel of the file's animation, sampled at the times of the frames.

    Others than of a node's place are kept as they are, if the motion begins with the animation.
    """
    assert motion.animation is not None
    node, path = channel["target"].get("node"), channel["target"]["path"]
    if node is None:
        return
    if path in REST:
        with np.errstate(all="ignore"):
            values = sampled_channel(file, motion.animation, channel, motion.times)
        document.animate(node, path, time, document.array(values, "VEC4" if path == "rotation" else "VEC3"))
    elif motion.times[0] == 0.0:
        document.samplers.append(motion.animation["samplers"][channel["sampler"]])
        document.channels.append({**channel, "sampler": len(document.samplers) - 1})


def add_played(document: Document, baked: BakedFile, time: int, garments: Sequence[np.ndarray]) -> None:
    """Move the garments of a played document: (F, N, 3) m of each at the times of an accessor."""
    for garment, vertices in zip(baked.garments, garments, strict=True):
        _add_garment(document, baked, garment, time, vertices)


def _add_garment(
    document: Document, baked: BakedFile, garment: BakedGarment, time: int, vertices: np.ndarray
) -> None:
    node = document.nodes[garment.node]
    mesh = document.meshes[node["mesh"]]
    attributes = mesh["primitives"][0]["attributes"]
    base = baked.file.array(attributes["POSITION"], "VEC3")
    faces = garment_faces(baked.file, garment)
    base_normals = vertex_normals(base[_firsts(garment)], faces)
    chunks = [slice(start, start + FRAMES_AT_ONCE) for start in range(0, len(vertices), FRAMES_AT_ONCE)]

    def offsets() -> Iterator[np.ndarray]:
        for frames in chunks:
            yield (baked.in_scene(vertices[frames])[:, garment.vertices] - base).astype(np.float32)

    def normal_offsets() -> Iterator[np.ndarray]:
        for frames in chunks:
            turned = vertex_normals(baked.in_scene(vertices[frames]), faces) - base_normals
            yield turned[:, garment.vertices].astype(np.float32)

    for primitive in mesh["primitives"]:
        bound = primitive["attributes"]
        primitive["attributes"] = {key: bound[key] for key in bound if not key.startswith(BINDING)}
    frames = len(vertices)
    weights = add_frames(document, mesh["primitives"], frames, len(base), offsets, normal_offsets)
    mesh["weights"] = [0.0] * frames
    mesh["extras"] = {"source_vertices": garment.vertices.tolist(), "targetNames": target_names(frames)}
    _put_at_root(document, garment.node)
    document.animate(garment.node, "weights", time, weights)


def _put_at_root(document: Document, node: int) -> None:
    """Take a node out of the tree and of its skin: its vertices are those of the scene."""
    for other in document.nodes:
        if node in other.get("children", ()):
            other["children"] = [child for child in other["children"] if child != node]
            if not other["children"]:
                del other["children"]
    for key in ("skin", "matrix", "translation", "rotation", "scale"):
        document.nodes[node].pop(key, None)
    if node not in document.roots:
        document.roots.append(node)


def garment_faces(file: GltfFile, garment: BakedGarment) -> np.ndarray:
    """Faces (F, 3) of a garment in a baked file, of the runtime's vertices."""
    return garment.vertices[mesh_faces(file, garment)]


def mesh_faces(file: GltfFile, garment: BakedGarment) -> np.ndarray:
    """Faces (F, 3) of a garment's mesh in a baked file.

    Raises ValueError naming the file if they are of vertices that it does not have.
    """
    mesh, count = file.entries("meshes")[file.entries("nodes")[garment.node]["mesh"]], len(garment.vertices)
    corners = [
        file.array(each["indices"], "SCALAR")[:, 0] if "indices" in each else np.arange(count)
        for each in mesh["primitives"]
    ]
    joined = np.concatenate(corners).astype(np.int64)
    if len(joined) % 3 or (joined >= count).any() or (joined < 0).any():
        raise file.error(f"the faces of {garment.name} do not fit its vertices")
    return joined.reshape(-1, 3)


def _firsts(garment: BakedGarment) -> np.ndarray:
    """First vertex (N,) of a garment's mesh for each of the runtime's."""
    return np.unique(garment.vertices, return_index=True)[1]


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (..., N, 3) of vertices, by the areas of their faces; without a face they point up (Y)."""
    first, second, third = (vertices[..., faces[:, corner], :] for corner in range(3))
    areas = np.cross(second - first, third - first)
    corners = faces.T.ravel()
    order = np.argsort(corners, kind="stable")
    used, starts = np.unique(corners[order], return_index=True)
    total = np.zeros_like(vertices)
    if len(faces):
        total[..., used, :] = np.add.reduceat(areas[..., order % len(faces), :], starts, axis=-2)
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    flat = length[..., 0] <= 0
    total = total / np.where(length > 0, length, 1.0)
    total[flat] = (0.0, 1.0, 0.0)
    return total
