"""Wavefront OBJ: one mesh with its texture coordinates, in its own vertex order."""

from pathlib import Path

import numpy as np

from rasterize.atomic import atomic_write
from rasterize.errors import InputError
from uvcloth.geometry.mesh import Mesh


def save_obj(mesh: Mesh, path: Path) -> None:
    """Write a mesh (metres, Z up), whole or not at all.

    Raises InputError for another suffix than .obj, or if the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".obj":
        raise InputError(f"{path}: a garment is written as .obj, not {path.suffix or 'without a suffix'}")
    with atomic_write(path) as partial, partial.open("w", encoding="utf-8") as stream:
        stream.write(f"# metres, Z up\no {path.stem}\n")
        np.savetxt(stream, mesh.vertices.numpy(), "v %.9g %.9g %.9g")
        np.savetxt(stream, mesh.uvs.numpy(), "vt %.9g %.9g")
        if len(mesh.uvs):
            corners = np.stack([mesh.faces.numpy(), mesh.face_uvs.numpy()], axis=-1) + 1
            np.savetxt(stream, corners.reshape(-1, 6), "f %d/%d %d/%d %d/%d")
        else:
            np.savetxt(stream, mesh.faces.numpy() + 1, "f %d %d %d")
