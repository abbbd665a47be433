"""Blender's cloth on one scene, run as `python blender_worker.py SCENE.npz` by a Python that has bpy.

Never imported: bpy is GPL and lives in an environment of its own. Writes the cloth's vertices (N, 3),
little-endian float32, to standard output as each frame is made.

A frame is the unit of time: Blender's cloth steps by frames, whatever their rate, and applies a thousandth of
the gravity that is set.
"""

import json
import os
import struct
import sys
from pathlib import Path
from typing import Any

# What Blender prints goes to standard error: standard output is for frames.
FRAME_STREAM = os.fdopen(os.dup(1), "wb")
os.dup2(2, 1)

import bpy  # noqa: E402
import numpy as np  # noqa: E402

SPRING_WEIGHT = 0.9997
"""Weight of a vertex that a spring pulls to its place; one of 1 is moved there without regard to contact."""


def main(path: Path) -> None:
    """Simulate the scene of a file and write its frames."""
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
        part = add_animated_mesh(path.parent / f"{name}.pc2", arrays[name], arrays[f"{name}_faces"], parts)
        add_collision(part, settings)
    cloth = add_animated_mesh(path.parent / "cloth.pc2", arrays["skinned"], arrays["faces"], scene.collection)
    add_cloth(cloth, arrays, settings, parts)
    for frame in range(scene.frame_start, scene.frame_end + 1):
        scene.frame_set(frame)
        FRAME_STREAM.write(vertex_positions(cloth).tobytes())
        FRAME_STREAM.flush()


def add_animated_mesh(cache: Path, frames: np.ndarray, faces: np.ndarray, collection: Any) -> Any:
    """Add an object whose mesh goes through frames (F, V, 3) m, by a point cache in the file `cache`."""
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


def add_collision(part: Any, settings: dict[str, Any]) -> None:
    """Let cloth collide with an object."""
    part.modifiers.new("collision", "COLLISION")
    part.collision.thickness_outer = settings["thickness"]
    part.collision.damping = 0.0
    part.collision.cloth_friction = settings["friction"]


def add_cloth(cloth: Any, arrays: dict[str, np.ndarray], settings: dict[str, Any], parts: Any) -> None:
    """Make an object cloth that collides with the collection `parts`."""
    modifier = cloth.modifiers.new("cloth", "CLOTH")
    modifier.point_cache.frame_start, modifier.point_cache.frame_end = 1, len(arrays["skinned"])
    motion, contact = modifier.settings, modifier.collision_settings
    for name, value in settings["cloth"].items():
        setattr(motion, name, value)
    for name, value in settings["contact"].items():
        setattr(contact, name, value)
    contact.collection, contact.use_collision = parts, len(parts.objects) > 0
    motion.vertex_group_mass = add_vertex_group(
        cloth, "band", arrays, 1.0 if settings["pinned"] else SPRING_WEIGHT
    )
    contact.vertex_group_object_collisions = add_vertex_group(cloth, "free", arrays)
    contact.vertex_group_self_collisions = add_vertex_group(cloth, "pressed", arrays)


def add_vertex_group(cloth: Any, name: str, arrays: dict[str, np.ndarray], weight: float = 1.0) -> str:
    """Group the vertices that the array of that name marks; returns the name, or "" where there are none."""
    members = np.flatnonzero(arrays[name]).tolist()
    if not members:
        return ""
    made = cloth.vertex_groups.new(name=name)
    made.add(members, weight, "REPLACE")
    return str(made.name)


def vertex_positions(cloth: Any) -> np.ndarray:
    """Positions of an object's vertices after the modifiers: (3 V,) float32, m."""
    evaluated = cloth.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    points = np.empty(3 * len(mesh.vertices), "<f4")
    mesh.vertices.foreach_get("co", points)
    evaluated.to_mesh_clear()
    return points


main(Path(sys.argv[1]))
