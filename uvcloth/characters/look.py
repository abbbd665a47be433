"""Materials of the parts of a character on their triangles."""

from collections.abc import Mapping, Sequence

import numpy as np

from uvcloth.characters.reader import Part
from uvcloth.geometry.authored import Labels, Polygons, SurfaceMaterial, UvSet


def polygons_of_parts(
    name: str,
    parts: Sequence[Part],
    corners: np.ndarray,
    uv_sets: tuple[UvSet, ...],
    materials: Mapping[str, SurfaceMaterial],
) -> Polygons:
    """The triangles of joined parts as polygons of one object, with the materials that the parts name.

    corners: (F, 3) vertices, part after part. materials: of the character's file, by name.
    """
    used = [materials[key] for key in dict.fromkeys(part.material for part in parts) if key in materials]
    row_of = {material.name: row for row, material in enumerate(used)}
    rows = [np.full(len(part.mesh.faces), row_of.get(part.material, -1)) for part in parts]
    return Polygons(
        sizes=np.full(len(corners), 3),
        corners=corners.reshape(-1),
        uv_sets=uv_sets,
        objects=Labels((name,), np.zeros(len(corners), np.int64)),
        groups=Labels((), np.full(len(corners), -1)),
        materials=tuple(used),
        material=np.concatenate(rows),
    )
