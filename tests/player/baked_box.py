"""The smallest baked file, without what a runtime reads: a box in a box of cloth, which bows and goes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from tests.small_body import small_body
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.writers.glb import Document
from uvcloth.writers.gltf_cloth import add_cloth, add_own_body, animate_cloth

FPS, FRAMES = 30.0, 16

CONTENT = b"what the runtime reads"
"""Bytes in the place of an outfit, which no box of eight vertices makes."""


def outfit() -> Outfit:
    """A box of cloth whose faces have corners of their own on its texture, over a box."""
    body = small_body()
    faces = body.mesh.faces
    uvs = body.mesh.uvs[faces].flatten(0, 1) + 0.01 * torch.arange(3 * len(faces))[:, None]
    face_uvs = torch.arange(3 * len(faces)).reshape(-1, 3)
    mesh = replace(body.mesh, vertices=1.1 * body.mesh.vertices, uvs=uvs, face_uvs=face_uvs)
    return Outfit(body, (Garment("coat", None, mesh, body.weights, body.weights),))


def transforms() -> np.ndarray:
    """(FRAMES, 2, 3, 4) from rest: the hips go, the chest bows by up to 60 degrees about its head."""
    share = np.linspace(0.0, 1.0, FRAMES)
    made = np.tile(np.eye(3, 4), (FRAMES, 2, 1, 1))
    made[:, 1, :, :3] = Rotation.from_euler("x", 60 * share[:, None], degrees=True).as_matrix()
    made[:, :, :, 3] = share[:, None, None] * [0.2, -0.5, 0.05]
    return made


def write_baked_box(path: Path) -> Path:
    """Write the baked file."""
    document, worn = Document(), outfit()
    skin = add_own_body(document, worn.body)
    add_cloth(document, skin, worn.garments, CONTENT)
    animate_cloth(document, skin, transforms(), FPS)
    document.write(path)
    return path
