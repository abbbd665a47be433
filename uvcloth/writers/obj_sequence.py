"""OBJ sequences: a file per frame, NAME_00000.obj and on, with all garments and the body as objects."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from uvcloth.geometry.authored import Labels, Polygons, SurfaceMaterial, polygons_of
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS, Color
from uvcloth.writers.animation import Animation, posed_body
from uvcloth.writers.obj import faces_text, save_materials


def write_obj_sequence(animation: Animation, path: Path) -> None:
    """Write NAME_00000.obj, NAME_00001.obj, ... and NAME.mtl beside path (NAME.obj): metres, Z up.

    Raises InputError if a material or a texture cannot be written.
    """
    meshes = [*animation.meshes, *([animation.body.mesh] if animation.body else [])]
    names = [*animation.names, *(["body"] if animation.body else [])]
    parts = [_named(polygons_of(mesh), name) for mesh, name in zip(meshes, names, strict=True)]
    if any(part.materials or part.groups.names for part in parts):
        shades = [GARMENT_COLORS[index % len(GARMENT_COLORS)] for index in range(len(animation.meshes))]
        parts = [_labelled(*each) for each in zip(parts, names, [*shades, BODY_COLOR], strict=False)]
    materials = tuple(material for part in parts for material in part.materials)
    head = "# metres, Z up\n"
    if materials:
        save_materials(materials, path.with_suffix(".mtl"))
        head += f"mtllib {path.stem}.mtl\n"
    faces, vertex, uv = "", 1, 1
    for part, mesh, name in zip(parts, meshes, names, strict=True):
        faces += faces_text(part, name, vertex, uv)
        vertex += len(mesh.vertices)
        uv += len(part.uv_sets[0].uvs) if part.uv_sets else 0
    for frame, places in enumerate(_frames(animation)):
        with path.with_name(f"{path.stem}_{frame:05d}.obj").open("w", encoding="utf-8") as stream:
            stream.write(head)
            for part, points in zip(parts, places, strict=True):
                colors = () if part.colors is None else (part.colors[:, :3],)
                rows = np.concatenate([points, *colors], axis=1)
                # One format for all lines is several times as fast as numpy.savetxt.
                lines = ("v" + " %.6f" * rows.shape[1] + "\n") * len(rows)
                stream.write(lines % tuple(rows.reshape(-1).tolist()))
            stream.write(faces)


def _named(polygons: Polygons, name: str) -> Polygons:
    """The polygons, names of materials and textures prefixed so that no other garment has them."""

    def prefixed(material: SurfaceMaterial) -> SurfaceMaterial:
        texture = material.texture
        texture = texture and replace(texture, name=f"{name}_{texture.name}")
        return replace(material, name=f"{name}_{material.name}", texture=texture)

    return replace(polygons, materials=tuple(map(prefixed, polygons.materials)))


def _labelled(polygons: Polygons, name: str, color: Color) -> Polygons:
    """The polygons, with a material and a group where they have none: they would take those before them."""
    groups, materials, material = polygons.groups, polygons.materials, polygons.material
    if (groups.of < 0).any():
        groups = Labels((*groups.names, name), np.where(groups.of < 0, len(groups.names), groups.of))
    if (material < 0).any():
        material = np.where(material < 0, len(materials), material)
        materials = (*materials, SurfaceMaterial(name, (*color, 1.0)))
    return replace(polygons, groups=groups, materials=materials, material=material)


def _frames(animation: Animation) -> Iterator[list[np.ndarray]]:
    """Vertices (N, 3) m of every garment, and of the body if there is one, frame by frame."""
    bodies = posed_body(animation) if animation.body else None
    for frames in animation.chunks():
        posed = None if bodies is None else next(bodies)
        for offset, frame in enumerate(range(frames.start, frames.stop)):
            places = [vertices[frame] for vertices in animation.vertices]
            yield places if posed is None else [*places, posed[offset]]
