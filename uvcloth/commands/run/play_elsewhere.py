"""Garments that were played, in the formats of `uvcloth rollout` besides glTF."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from uvcloth.geometry.mesh import Mesh
from uvcloth.player.baked import BakedFile, BakedGarment, JointMotion
from uvcloth.writers.gltf_played import mesh_faces
from uvcloth.writers.writer import open_writer


def write_garments(
    path: Path, baked: BakedFile, motion: JointMotion, garments: Sequence[np.ndarray]
) -> tuple[Path, ...]:
    """Write garments (F, N, 3) m in the format of the path's suffix, Z up, without the body.

    Returns the files. Raises InputError as `open_writer` does.
    """
    meshes = [(garment.name, _at_rest(baked, garment)) for garment in baked.garments]
    with open_writer(path, meshes, None, motion.fps) as writer:
        writer.add([torch.from_numpy(vertices) for vertices in garments])
    return writer.written


def _at_rest(baked: BakedFile, garment: BakedGarment) -> Mesh:
    """Mesh of a garment in the file, at rest, in the runtime's world."""
    file, faces = baked.file, mesh_faces(baked.file, garment)
    node = file.entries("nodes")[garment.node]
    attributes = file.entries("meshes")[node["mesh"]]["primitives"][0]["attributes"]
    points = file.array(attributes["POSITION"], "VEC3") @ baked.skin.axes[:3, :3].T
    vertices = np.zeros((garment.size, 3), np.float32)
    vertices[garment.vertices] = points
    uvs = np.zeros((0, 2), np.float32)
    if "TEXCOORD_0" in attributes:
        # glTF measures the second coordinate from the top of the picture.
        uvs = (file.array(attributes["TEXCOORD_0"], "VEC2") * [1, -1] + [0, 1]).astype(np.float32)
    return Mesh(
        torch.from_numpy(vertices),
        torch.from_numpy(garment.vertices[faces]),
        torch.from_numpy(uvs),
        torch.from_numpy(faces if len(uvs) else np.zeros_like(faces)),
    )
