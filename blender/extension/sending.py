"""Files for the laboratory: a character as glTF, its garments as OBJ."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .rig import TO_Z_UP, even_scale


def skin_meshes(context: Any, armature: Any, garments: Sequence[Any]) -> list[Any]:
    """Visible meshes that an armature deforms, without the garments. Raises ValueError if there are none."""
    parts = [
        part
        for part in context.view_layer.objects
        if part.type == "MESH" and part not in garments and part.visible_get() and _is_skinned(part, armature)
    ]
    if not parts:
        raise ValueError(f"{armature.name} has no visible skin: a mesh with an Armature modifier for it")
    return parts


def _is_skinned(part: Any, armature: Any) -> bool:
    bones = set(armature.data.bones.keys())
    return bool(bones & set(part.vertex_groups.keys())) and any(
        modifier.type == "ARMATURE" and modifier.object == armature for modifier in part.modifiers
    )


def write_character(context: Any, armature: Any, skins: Sequence[Any], path: Path) -> None:
    """Write an armature at rest and its skin meshes as .glb, by Blender's exporter.

    The selection stays. Raises ValueError if that fails.
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
            export_animations=False,
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
    """Write a garment as OBJ at its armature's rest: the mesh without modifiers, Y up like the character.

    Its origin is the armature's, its unit the world's. Raises ValueError for a scale that is not even.
    """
    mesh, place = garment.data, np.array(armature.matrix_world, np.float64)
    size = even_scale(place)
    to_origin = np.linalg.inv(TO_Z_UP) @ np.diag([size, size, size, 1.0]) @ np.linalg.inv(place)
    whole = to_origin @ np.array(garment.matrix_world, np.float64)
    points = vertices_of(mesh) @ whole[:3, :3].T + whole[:3, 3]
    lines = ["v {:.7f} {:.7f} {:.7f}".format(*point) for point in points]
    layer = mesh.uv_layers.active
    if layer is not None:
        lines += ["vt {:.6f} {:.6f}".format(*corner.uv) for corner in layer.data]
    for face in mesh.polygons:
        corners = zip(face.vertices, face.loop_indices, strict=True)
        words = (f"{vertex + 1}/{loop + 1}" if layer else f"{vertex + 1}" for vertex, loop in corners)
        lines.append("f " + " ".join(words))
    path.write_text("\n".join([f"o {path.stem}", *lines, ""]), encoding="utf-8")


def vertices_of(mesh: Any) -> NDArray[np.float64]:
    """Vertices (V, 3) of a mesh."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(np.float64)
