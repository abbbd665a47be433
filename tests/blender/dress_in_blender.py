"""Run by a Python that has bpy: python dress_in_blender.py EXTENSION.zip BAKED.glb SKIRT.obj PYTHON FOLDER

Dresses a character in an artist's own mesh, on an armature that is somewhere else, twice its size.
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

EXTENSION, BAKED, SKIRT, PYTHON, FOLDER = (Path(each) for each in sys.argv[1:])
said: dict[str, object] = {"refused": []}


def refused(**options) -> None:
    """Dress, and note what it says."""
    try:
        bpy.ops.uvcloth.dress(quality="fast", **options)
    except RuntimeError as error:
        said["refused"].append(str(error).strip())
    else:
        said["refused"].append("")


def select(*parts) -> None:
    """Select objects, the last of them active."""
    for part in bpy.context.selected_objects:
        part.select_set(False)
    for part in parts:
        part.select_set(True)
    bpy.context.view_layer.objects.active = parts[-1]


def distances(garment, body) -> np.ndarray:
    """Distances (V,) of a garment from the body, as they are drawn, m."""
    graph = bpy.context.evaluated_depsgraph_get()
    tree = BVHTree.FromObject(body, graph)
    drawn, back = garment.evaluated_get(graph), body.evaluated_get(graph).matrix_world.inverted()
    place = back @ drawn.matrix_world
    return np.array([tree.find_nearest(place @ vertex.co)[3] for vertex in drawn.to_mesh().vertices])


bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.extensions.package_install_files(filepath=str(EXTENSION), repo="user_default", enable_on_install=True)
preferences = bpy.context.preferences.addons["bl_ext.user_default.uvcloth"].preferences
from bl_ext.user_default.uvcloth import live  # noqa: E402

scene = bpy.context.scene
scene.render.fps = 30
bpy.ops.import_scene.gltf(filepath=str(BAKED))
bpy.data.objects.remove(bpy.data.objects["dress"])
armature, body = bpy.data.objects["Armature"], bpy.data.objects["body"]
bpy.ops.wm.obj_import(filepath=str(SKIRT), forward_axis="Y", up_axis="Z")
skirt = bpy.context.selected_objects[0]
skirt.parent = armature
below = skirt.modifiers.new("round", "SUBSURF")
below.levels = 0
armature.rotation_mode = "XYZ"
armature.location, armature.rotation_euler = (2.0, 1.0, 0.0), (0.0, 0.0, 0.5)
armature.scale = (2.0, 2.0, 2.0)
bpy.context.view_layer.update()

select(armature)
refused()  # Nothing to wear.
select(skirt, armature)
refused()  # No laboratory.
preferences.python = str(FOLDER / "nowhere")
bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "scene.blend"))
refused()  # None that runs.
preferences.python = sys.executable
refused()  # One without uvcloth.
preferences.python = str(PYTHON)
body.hide_set(True)
refused()  # No skin.
body.hide_set(False)
armature.scale = (-2.0, 2.0, 2.0)
bpy.context.view_layer.update()
refused()
armature.scale = (2.0, 2.0, 2.0)
bpy.context.view_layer.update()
said["untouched"] = [modifier.type for modifier in skirt.modifiers], armature.uvcloth.file

bpy.ops.uvcloth.dress(quality="fast")
said["modifiers"] = [modifier.type for modifier in skirt.modifiers]
said["file"] = armature.uvcloth.file
near = {}
for frame in range(31):
    scene.frame_set(frame)
    if frame in (0, 30):
        near[frame] = distances(skirt, body)
said["fault"] = live.FAULTS.get(armature.session_uid, "")
np.savez(FOLDER / "arrays.npz", first=near[0], last=near[30])
(FOLDER / "said.json").write_text(json.dumps(said), encoding="utf-8")
