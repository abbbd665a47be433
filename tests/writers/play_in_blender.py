"""Run by a Python that has bpy: python play_in_blender.py FILE OUT.npz FPS MESH ... -- FRAME ...

Imports the file as an artist would and writes the evaluated vertices of each mesh, (frames, V, 3), world.
"""

import sys

import bpy
import numpy as np

file, out, fps, *rest = sys.argv[1:]
names, frames = rest[: rest.index("--")], [int(frame) for frame in rest[rest.index("--") + 1 :]]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps = int(fps)
if file.endswith(".glb"):
    bpy.ops.import_scene.gltf(filepath=file)
else:
    bpy.ops.wm.usd_import(filepath=file)
# From glTF an animated mesh hangs on an empty of its name and gets another; its data keep the name.
objects = {part.data.name: part for part in bpy.data.objects if part.type == "MESH"}
played: dict[str, list[np.ndarray]] = {name: [] for name in names}
for frame in frames:
    scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    for name in names:
        evaluated = objects[name].evaluated_get(graph)
        mesh = evaluated.to_mesh()
        points = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", points)
        world = np.array(evaluated.matrix_world)
        played[name].append(points.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3])
        evaluated.to_mesh_clear()
np.savez(out, **{name: np.stack(parts) for name, parts in played.items()})
