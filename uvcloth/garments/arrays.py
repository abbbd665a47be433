"""Garment meshes from arrays, checked as those of files are."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from uvcloth.files.fields import indices, numbers
from uvcloth.formats.mesh_file import check_mesh
from uvcloth.geometry.arrays import Array, check_arrays
from uvcloth.geometry.mesh import Mesh

SURFACE = {"vertices": numbers("N", 3, dtype=np.float64), "faces": indices("M", 3, of="N")}
"""Arrays that every mesh has: N vertices, M triangles."""

TEXTURE = {"uvs": numbers("U", 2), "face_uvs": indices("M", 3, of="U")}
"""Arrays of a mesh that has texture coordinates."""


@dataclass(frozen=True)
class NamedMesh:
    """A mesh in any unit and axes that is to be a garment, and the name of the garment."""

    name: str
    mesh: Mesh


def named_mesh(name: str, source: Mesh | tuple[Array, Array]) -> NamedMesh:
    """Name a mesh, or vertices (N, 3) and triangles (M, 3) of whole numbers, as a garment.

    Raises InputError naming the garment, and the array, for another shape or kind, a value that is not a
    finite number, a vertex that does not exist, no faces, and a mesh that is too large.
    """
    if not isinstance(source, Mesh):
        empty = torch.zeros(0, 3, dtype=torch.int64)
        checked = check_arrays(name, dict(zip(SURFACE, source, strict=True)), SURFACE)
        vertices, faces = (torch.from_numpy(checked[field]) for field in SURFACE)
        source = Mesh(vertices, faces, torch.zeros(0, 2), empty)
    else:
        fields = SURFACE | (TEXTURE if len(source.uvs) else {})
        checked = check_arrays(name, {field: getattr(source, field) for field in fields}, fields)
        source = replace(source, **{field: torch.from_numpy(array) for field, array in checked.items()})
    check_mesh(Path(name), source)
    return NamedMesh(name, source)
