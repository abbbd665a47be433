"""What is sent to the laboratory: a character as glTF, its garments as OBJ, and how they are worn."""

from collections.abc import Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils.kdtree import KDTree
from numpy.typing import NDArray

from . import surface
from .rig import TO_Z_UP, even_scale
from .selection import objects_of

LONGEST_NAME = 60
"""Letters of a garment's name in the laboratory."""

PINNED = 0.5
"""Weight in a vertex group from which on a vertex is pinned."""


def send(
    context: Any, armature: Any, entries: Sequence[Any], folder: Path, moves: bool = False
) -> tuple[list[str], list[str | Path]]:
    """Write a character and the garments of its entries into a folder.

    moves: with the motion of the scene's frames. Returns names of the garments in the laboratory, and the
    options that name the files and say how they are worn. Raises ValueError in a sentence, and OSError.
    """
    garments = [entry.part for entry in entries]
    skins = skin_meshes(context, armature)
    write_character(context, armature, skins, folder / "character.glb", moves)
    names = plain_names([garment.name for garment in garments])
    words: list[str | Path] = ["--body", folder / "character.glb", "--garment"]
    for garment, name in zip(garments, names, strict=True):
        surface.place_of_cloth(garment)
        write_garment(garment, armature, folder / f"{name}.obj")
        words.append(folder / f"{name}.obj")
    words += ["--fabric", *(entry.fabric for entry in entries)]
    name_of = dict(zip(garments, names, strict=True))
    if tucks := [f"{name_of[e.part]}:{name_of[e.into]}" for e in entries if e.into in name_of]:
        words += ["--tuck", *tucks]
    holds = []
    for entry, name in zip(entries, names, strict=True):
        if entry.hold != "FOUND":
            holds.append(f"{name}:{entry.hold.lower()}")
        if entry.pins or entry.bone:
            write_pins(entry, armature, skins, folder / f"{name}.txt")
            holds.append(f"{name}:{name}.txt")
    if holds:
        words += ["--hold", *holds]
    return names, words


def plain_names(names: Sequence[str]) -> list[str]:
    """Names that files can have, each once."""
    plain: list[str] = []
    for name in names:
        clean = "".join(letter if letter.isalnum() else "_" for letter in name).strip("_")[:LONGEST_NAME]
        clean = clean or "garment"
        taken = {other.lower() for other in plain}
        choices = chain([clean], (f"{clean}_{number}" for number in count(len(plain))))
        plain.append(next(choice for choice in choices if choice.lower() not in taken))
    return plain


def write_pins(entry: Any, armature: Any, skins: Sequence[Any], path: Path) -> None:
    """Write the numbers of the vertices that a garment's vertex group and bone pin. Raises ValueError."""
    pinned = set(_in_group(entry.part, entry.pins) if entry.pins else ())
    if entry.bone:
        pinned.update(near_bone(entry.part, armature, skins, entry.bone))
    path.write_text("\n".join(map(str, sorted(pinned))), encoding="utf-8")


def _in_group(garment: Any, group: str) -> list[int]:
    """Vertices of a vertex group. Raises ValueError if it is gone or empty."""
    index = garment.vertex_groups.find(group)
    if index < 0:
        raise ValueError(
            f"{garment.name} has no vertex group {group} any more: choose another one for its pins"
        )
    pinned = [
        vertex.index
        for vertex in garment.data.vertices
        if any(entry.group == index and entry.weight >= PINNED for entry in vertex.groups)
    ]
    if not pinned:
        raise ValueError(f"no vertex of {garment.name} is pinned: vertex group {group} is empty")
    return pinned


def near_bone(garment: Any, armature: Any, skins: Sequence[Any], bone: str) -> list[int]:
    """Vertices of a garment at rest whose closest vertex of the skin follows a bone more than any other.

    Raises ValueError if there are none, or no such bone.
    """
    bones = armature.data.bones
    if bone not in bones:
        raise ValueError(f"{armature.name} has no bone {bone} any more: choose another one for the pins")
    tree = KDTree(sum(len(skin.data.vertices) for skin in skins))
    follows: list[bool] = []
    for skin in skins:
        names = [group.name for group in skin.vertex_groups]
        for vertex in skin.data.vertices:
            weights = {names[entry.group]: entry.weight for entry in vertex.groups}
            strongest = max((name for name in weights if name in bones), key=weights.__getitem__, default="")
            tree.insert(skin.matrix_world @ vertex.co, len(follows))
            follows.append(strongest == bone)
    tree.balance()
    world = garment.matrix_world
    pinned = [vertex.index for vertex in garment.data.vertices if follows[tree.find(world @ vertex.co)[1]]]
    if not pinned:
        raise ValueError(f"no vertex of {garment.name} is pinned: none lies on skin of bone {bone}")
    return pinned


def skin_meshes(context: Any, armature: Any) -> list[Any]:
    """Visible meshes that an armature deforms, without its garments. Raises ValueError if there are none."""
    worn = objects_of(armature)
    parts = [
        part
        for part in context.view_layer.objects
        if part.type == "MESH" and part not in worn and part.visible_get() and _is_skinned(part, armature)
    ]
    if not parts:
        raise ValueError(f"{armature.name} has no visible skin: a mesh with an Armature modifier for it")
    return parts


def _is_skinned(part: Any, armature: Any) -> bool:
    bones = set(armature.data.bones.keys())
    return bool(bones & set(part.vertex_groups.keys())) and any(
        modifier.type == "ARMATURE" and modifier.object == armature for modifier in part.modifiers
    )


def write_character(
    context: Any, armature: Any, skins: Sequence[Any], path: Path, moves: bool = False
) -> None:
    """Write an armature at rest and its skin meshes as .glb, by Blender's exporter.

    moves: with their motion in the scene's frames, constraints and drivers included. The selection stays.
    Raises ValueError if that fails.
    """
    active, selected = context.view_layer.objects.active, list(context.selected_objects)
    for part in selected:
        part.select_set(False)
    for part in (armature, *skins):
        part.select_set(True)
    try:
        bpy.ops.export_scene.gltf(
            filepath=str(path),
            export_format="GLB",
            use_selection=True,
            export_animations=moves,
            export_animation_mode="SCENE",
            export_force_sampling=True,
            export_frame_range=True,
            export_morph=False,
            export_rest_position_armature=True,
        )
    except RuntimeError as error:
        raise ValueError(f"Blender cannot export {armature.name} ({error})") from error
    finally:
        for part in (armature, *skins):
            part.select_set(False)
        for part in selected:
            part.select_set(True)
        context.view_layer.objects.active = active


def write_garment(garment: Any, armature: Any, path: Path) -> None:
    """Write a garment as OBJ at its armature's rest: the mesh without modifiers, see `to_file`."""
    mesh, whole = garment.data, to_file(garment, armature)
    points = vertices_of(mesh) @ whole[:3, :3].T + whole[:3, 3]
    lines = ["v {:.7f} {:.7f} {:.7f}".format(*point) for point in points]
    places = _texture_places(mesh)
    if places is not None:
        coordinates, place_of = places
        lines += ["vt {:.6f} {:.6f}".format(*place) for place in coordinates]
    way = -1 if np.linalg.det(whole[:3, :3]) < 0.0 else 1  # A mirror turns faces inside out.
    for face in mesh.polygons:
        corners = list(zip(face.vertices, face.loop_indices, strict=True))[::way]
        words = (
            f"{vertex + 1}/{place_of[loop] + 1}" if places else f"{vertex + 1}" for vertex, loop in corners
        )
        lines.append("f " + " ".join(words))
    path.write_text("\n".join([f"o {path.stem}", *lines, ""]), encoding="utf-8")


def _texture_places(mesh: Any) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """Texture coordinates (T, 2) of the active layer, and which of them each corner has; None without one.

    Corners of a vertex with the same coordinates share them, so that faces hang together on the sheet.
    """
    layer = mesh.uv_layers.active
    if layer is None:
        return None
    uvs, vertices = np.empty(2 * len(mesh.loops), np.float32), np.empty(len(mesh.loops), np.int32)
    layer.data.foreach_get("uv", uvs)
    mesh.loops.foreach_get("vertex_index", vertices)
    rows = np.column_stack([vertices, uvs.reshape(-1, 2).round(6)])
    places, place_of = np.unique(rows, axis=0, return_inverse=True)
    return places[:, 1:].astype(np.float64), place_of.ravel().astype(np.int64)


def to_file(garment: Any, armature: Any) -> NDArray[np.float64]:
    """Transform (4, 4) from an object's mesh to the character's file, which has the world with Y up.

    Raises ValueError for an armature whose scale is not even.
    """
    even_scale(np.array(armature.matrix_world, np.float64))
    return np.linalg.inv(TO_Z_UP) @ np.array(garment.matrix_world, np.float64)


def vertices_of(mesh: Any) -> NDArray[np.float64]:
    """Vertices (V, 3) of a mesh."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(np.float64)
