"""Wavefront OBJ: meshes in their own vertex order, with polygons, groups and materials as they were read."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_write
from uvcloth.geometry.authored import Polygons, SurfaceMaterial, polygons_of
from uvcloth.geometry.mesh import Mesh
from uvcloth.writers.textures import save_texture


def save_obj(mesh: Mesh, path: Path) -> None:
    """Write a mesh (metres, Z up), whole or not at all; its materials and textures into files beside it.

    Raises InputError for another suffix than .obj, or if a file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".obj":
        raise InputError(f"{path}: a garment is written as .obj, not {path.suffix or 'without a suffix'}")
    polygons = polygons_of(mesh)
    if polygons.materials:
        save_materials(polygons.materials, path.with_suffix(".mtl"))
    with atomic_write(path) as partial, partial.open("w", encoding="utf-8") as stream:
        stream.write("# metres, Z up\n")
        if polygons.materials:
            stream.write(f"mtllib {path.stem}.mtl\n")
        rows, form = mesh.vertices.numpy(), "v %.9g %.9g %.9g"
        if polygons.colors is not None:
            rows, form = np.concatenate([rows, polygons.colors[:, :3]], axis=1), form + " %.6g %.6g %.6g"
        np.savetxt(stream, rows, form)
        stream.write(faces_text(polygons, path.stem))


def faces_text(polygons: Polygons, name: str, first_vertex: int = 1, first_uv: int = 1) -> str:
    """Texture coordinates and faces as lines of an OBJ; name: of the object if polygons have none.

    first_vertex, first_uv: numbers in the file of the mesh's first vertex and texture coordinate.
    """
    lines = [] if polygons.objects.names else [f"o {name}"]
    numbers = (polygons.corners + first_vertex).astype(str)
    if polygons.uv_sets:
        uvs, corners = polygons.uv_sets[0].uvs, polygons.uv_sets[0].corners
        lines += [f"vt {u:.9g} {v:.9g}" for u, v in uvs.tolist()]
        numbers = np.char.add(np.char.add(numbers, "/"), (corners + first_uv).astype(str))
    ends = np.cumsum(polygons.sizes)
    states = _states(polygons)
    for start, end, state in zip(ends - polygons.sizes, ends, states, strict=True):
        lines += state
        lines.append("f " + " ".join(numbers[start:end]))
    return "\n".join(lines) + "\n"


def _states(polygons: Polygons) -> Iterator[list[str]]:
    """Lines that precede each polygon: object, group and material where they change."""
    names = [material.name for material in polygons.materials]
    tracks: list[tuple[str, Sequence[str], list[int]]] = [
        ("o", polygons.objects.names, polygons.objects.of.tolist()),
        ("g", polygons.groups.names, polygons.groups.of.tolist()),
        ("usemtl", names, polygons.material.tolist()),
    ]
    now = [-1] * len(tracks)
    for index in range(len(polygons.sizes)):
        lines = []
        for track, (word, labels, of) in enumerate(tracks):
            if of[index] != now[track]:
                now[track] = of[index]
                lines.append(f"{word} {labels[of[index]] if of[index] >= 0 else 'default'}")
        yield lines


def save_materials(materials: Sequence[SurfaceMaterial], path: Path) -> None:
    """Write an .mtl, and the textures beside it as NAME_TEXTURE.

    Raises InputError if one cannot be written.
    """
    lines = []
    for material in materials:
        red, green, blue, opacity = material.color
        lines += [f"newmtl {material.name}", f"Kd {red:.6g} {green:.6g} {blue:.6g}", f"d {opacity:.6g}"]
        if material.texture:
            lines.append(f"map_Kd {save_texture(material.texture, path)}")
    with atomic_write(path) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")
