"""Blender's cloth on one scene, run as `python blender_worker.py SCENE.npz` by a Python that has bpy.

Never imported: bpy is GPL and lives in an environment of its own. Writes the cloth's vertices to standard
output, (N, 3) little-endian float32 after another, one for each frame as it is made.

A frame is the unit of time: Blender's cloth steps by frames, whatever their rate, and takes a thousandth of
the gravity that it is told.
"""

import json
import os
import struct
import sys
from pathlib import Path
from typing import Any

# What Blender prints goes to standard error: standard output is for frames.
FRAMES = os.fdopen(os.dup(1), "wb")
os.dup2(2, 1)

import bpy  # noqa: E402
import numpy as np  # noqa: E402

PULLED = 0.9997
"""Weight of a vertex that a spring pulls to its place; one of 1 is moved there whatever stands in its way."""


def main(path: Path) -> None:
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files}
    settings = json.loads(str(arrays["settings"]))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, len(arrays["skinned"])
    scene.gravity = (0.0, 0.0, -1e3 * settings["gravity"])
    parts = bpy.data.collections.new("parts")
    scene.collection.children.link(parts)
    for name in sorted(name for name in arrays if name.startswith("part") and "_" not in name):
        part = moving(path.parent / f"{name}.pc2", arrays[name], arrays[f"{name}_faces"], parts)
        collide(part, settings)
    cloth = moving(path.parent / "cloth.pc2", arrays["skinned"], arrays["faces"], scene.collection)
    become_cloth(cloth, arrays, settings, parts)
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        FRAMES.write(points_of(cloth).tobytes())
        FRAMES.flush()


def moving(cache: Path, frames: np.ndarray, faces: np.ndarray, collection: Any) -> Any:
    """An object whose mesh goes through frames (F, V, 3), by a point cache in the file `cache`."""
    with cache.open("wb") as stream:
        count = frames.shape[1]
        stream.write(struct.pack("<12siiffi", b"POINTCACHE2\0", 1, count, 0.0, 1.0, len(frames)))
        stream.write(np.ascontiguousarray(frames, "<f4").data)
    mesh = bpy.data.meshes.new(cache.stem)
    mesh.from_pydata(frames[0].tolist(), [], faces.tolist())
    made = bpy.data.objects.new(cache.stem, mesh)
    collection.objects.link(made)
    played = made.modifiers.new("cache", "MESH_CACHE")
    played.cache_format, played.filepath, played.frame_start = "PC2", str(cache), 1
    played.forward_axis, played.up_axis = "POS_Y", "POS_Z"
    return made


def collide(part: Any, settings: dict[str, Any]) -> None:
    part.modifiers.new("collision", "COLLISION")
    part.collision.thickness_outer = settings["thickness"]
    part.collision.damping = 0.0
    part.collision.cloth_friction = settings["friction"]


def become_cloth(cloth: Any, arrays: dict[str, np.ndarray], settings: dict[str, Any], parts: Any) -> None:
    modifier = cloth.modifiers.new("cloth", "CLOTH")
    modifier.point_cache.frame_start, modifier.point_cache.frame_end = 1, len(arrays["skinned"])
    moved, met = modifier.settings, modifier.collision_settings
    for name, value in settings["cloth"].items():
        setattr(moved, name, value)
    for name, value in settings["contact"].items():
        setattr(met, name, value)
    met.collection, met.use_collision = parts, len(parts.objects) > 0
    moved.vertex_group_mass = group(cloth, "band", arrays, 1.0 if settings["pinned"] else PULLED)
    met.vertex_group_object_collisions = group(cloth, "free", arrays)
    met.vertex_group_self_collisions = group(cloth, "pressed", arrays)


def group(cloth: Any, name: str, arrays: dict[str, np.ndarray], weight: float = 1.0) -> str:
    """The name of a group of the vertices that the array of that name says, or "" where there are none."""
    members = np.flatnonzero(arrays[name]).tolist()
    if not members:
        return ""
    made = cloth.vertex_groups.new(name=name)
    made.add(members, weight, "REPLACE")
    return str(made.name)


def points_of(cloth: Any) -> np.ndarray:
    """(3 V,) float32, as the modifiers leave them."""
    evaluated = cloth.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    points = np.empty(3 * len(mesh.vertices), "<f4")
    mesh.vertices.foreach_get("co", points)
    evaluated.to_mesh_clear()
    return points


main(Path(sys.argv[1]))
