"""Parts of glTF files that animations and rigs share: meshes at rest, a skeleton, its poses, and skins.

glTF has one texture coordinate per vertex, so vertices on texture seams are repeated after the mesh's own
vertices, and the mesh's `extras.source_vertices` names the original of each.
"""

from typing import Any

import numpy as np
import torch

from uvcloth.geometry.mesh import Mesh, vertex_normals
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.writers.animation import local_poses
from uvcloth.writers.glb import BYTE, FLOAT, SHORT, VERTICES, Document

GLTF_INFLUENCES = 4
"""Joint influences per vertex that every glTF reader supports."""

# Z up, facing -Y -> Y up, facing +Z.
TO_Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], np.float32)


def add_influences(
    document: Document, joints: np.ndarray, weights: np.ndarray, compact: bool = False
) -> dict[str, int]:
    """Add attributes that bind M vertices to the joints (M, 4) of a skin, with weights (M, 4).

    compact: weights as 65535ths, in half the bytes; the strongest takes what the sum lacks.
    """
    kind = BYTE if joints.max(initial=0) < 256 else SHORT
    bound = {"JOINTS_0": document.array(joints, "VEC4", kind, VERTICES)}
    if not compact:
        return {**bound, "WEIGHTS_0": document.array(weights, "VEC4", FLOAT, VERTICES)}
    whole = np.iinfo(np.uint16).max
    shares = np.round(weights * whole).astype(np.int64)
    shares[np.arange(len(shares)), shares.argmax(1)] += whole - shares.sum(1)
    bound["WEIGHTS_0"] = document.array(shares, "VEC4", SHORT, VERTICES)
    document.accessors[-1]["normalized"] = True
    return bound


def add_skeleton(document: Document, skeleton: Skeleton) -> tuple[int, int]:
    """Add nodes of all joints, in order, and a skin on them.

    Returns the index of the skin and that of the first node. At rest every joint has the axes of the scene.
    """
    heads = skeleton.heads.numpy() @ TO_Y_UP.T
    first = len(document.nodes)
    inverse_bind = np.tile(np.eye(4, dtype=np.float32), (len(heads), 1, 1))
    inverse_bind[:, 3, :3] = -heads  # Column-major: the last four numbers are the shift.
    document.skins.append(
        {
            "inverseBindMatrices": document.array(inverse_bind.reshape(-1, 16), "MAT4"),
            "joints": list(range(first, first + len(heads))),
        }
    )
    for joint, parent in enumerate(skeleton.parents):
        bone = heads[joint] - heads[parent] if parent >= 0 else heads[joint]
        node: dict[str, Any] = {"name": skeleton.names[joint], "translation": bone.tolist()}
        children = [first + child for child, of in enumerate(skeleton.parents) if of == joint]
        document.nodes.append(node | ({"children": children} if children else {}))
        if parent < 0:
            document.roots.append(first + joint)
    return len(document.skins) - 1, first


def animate_skeleton(
    document: Document, skeleton: Skeleton, first: int, transforms: np.ndarray, time: int
) -> None:
    """Pose the nodes of `add_skeleton` by transforms (F, J, 3, 4) at F times (an accessor)."""
    heads = skeleton.heads.numpy() @ TO_Y_UP.T
    parts = zip(*local_poses(skeleton, transforms), strict=True)
    translations, rotations = (np.concatenate(part) for part in parts)
    for joint, parent in enumerate(skeleton.parents):
        bone = heads[joint] - heads[parent] if parent >= 0 else heads[joint]
        quaternions = rotations[:, joint]
        turned = np.concatenate([quaternions[:, :3] @ TO_Y_UP.T, quaternions[:, 3:]], axis=1)
        document.animate(first + joint, "rotation", time, document.array(turned, "VEC4"))
        shifts = translations[:, joint] @ TO_Y_UP.T
        if np.abs(shifts - bone).max() > 1e-6:
            document.animate(first + joint, "translation", time, document.array(shifts, "VEC3"))


def split_seams(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split a mesh at its UV seams: source vertices (M,), faces (F, 3), one texture coordinate each (M, 2).

    The first V vertices are the mesh's own in their order; the repeated ones of seams follow.
    """
    sets = [mesh.face_uvs.numpy().ravel()] if len(mesh.uvs) else []
    source, place, rows, keys = split_corners(len(mesh.vertices), mesh.faces.numpy().ravel(), sets)
    uvs = np.zeros((len(source), 2), np.float32)
    if sets:
        uvs[rows] = mesh.uvs.numpy()[keys[:, 0]]
    return source, place.reshape(-1, 3), uvs


def split_corners(
    count: int, corners: np.ndarray, sets: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Split vertices whose corners have different texture coordinates.

    corners: (C,) vertex of each corner. sets: per UV set, the texture coordinate of each corner (C,). Returns
    the source of each new vertex (M,), of which the first `count` are the mesh's own, and the new vertex of
    each corner (C,); for the K new vertices that are a corner, their index (K,) and their texture coordinates
    (K, sets).
    """
    pairs, corner = np.unique(np.stack([corners, *sets], axis=1), axis=0, return_inverse=True)
    owner = pairs[:, 0]
    first = np.r_[True, owner[1:] != owner[:-1]]
    place = np.where(first, owner, count + np.cumsum(~first) - 1)
    source = np.concatenate([np.arange(count), owner[~first]])
    return source, place[corner.ravel()], place, pairs[:, 1:]


def unit_normals(vertices: np.ndarray, mesh: Mesh) -> np.ndarray:
    """Unit normals (..., V, 3); a vertex without faces points up."""
    normals = vertex_normals(torch.from_numpy(vertices), mesh.faces).numpy()
    normals[np.linalg.norm(normals, axis=-1) < 0.5] = (0.0, 0.0, 1.0)
    return normals
