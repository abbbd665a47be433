"""The UV layout of a garment's mesh."""

import numpy as np
import torch

from rasterize.charts import face_components
from rasterize.layout import Layout, unwrap
from uvcloth.geometry.mesh import Mesh


def own_layout(mesh: Mesh) -> Layout:
    """A mesh's own texture coordinates as a layout of all of its faces; unwrapped where it has none."""
    uvs, face_uvs = (
        (mesh.uvs, mesh.face_uvs) if len(mesh.uvs) else unwrap(mesh.vertices, mesh.faces, "garment")
    )
    islands = face_components(face_uvs.numpy(), np.zeros(0, dtype=np.int64))
    return Layout(torch.arange(len(face_uvs)), uvs, face_uvs, torch.from_numpy(islands).long())
