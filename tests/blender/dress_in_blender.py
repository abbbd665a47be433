"""Run by a Python that has bpy: dress_in_blender.py EXTENSION.zip BAKED.glb SKIRT.obj TOPS.obj PYTHON FOLDER

Dresses a character in an artist's own meshes, on an armature with names of its own that is somewhere else, a
hundred times its size; the skirt's object is mirrored and stretched.
"""

import json
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
from mathutils import Quaternion
from mathutils.bvhtree import BVHTree

EXTENSION, BAKED, SKIRT, TOPS, PYTHON, FOLDER = (Path(each) for each in sys.argv[1:])
SKIRT_SCALE = (-1.0, 1.25, 1.0)
said: dict[str, object] = {"refused": [], "reports": []}
arrays: dict[str, np.ndarray] = {}


def refused(command=None, **options) -> None:
    """Run a command, dressing if none is named, and note what it says."""
    try:
        command(**options) if command else bpy.ops.uvcloth.dress(quality="fast", **options)
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


def vertices(part) -> np.ndarray:
    """Vertices (V, 3) of a mesh."""
    points = np.empty(3 * len(part.data.vertices), np.float32)
    part.data.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


def distances(garment, body) -> np.ndarray:
    """Distances (V,) of a garment from the body, as they are drawn, m."""
    graph = bpy.context.evaluated_depsgraph_get()
    tree = BVHTree.FromObject(body, graph)
    drawn, back = garment.evaluated_get(graph), body.evaluated_get(graph).matrix_world.inverted()
    place = back @ drawn.matrix_world
    return np.array([tree.find_nearest(place @ vertex.co)[3] for vertex in drawn.to_mesh().vertices])


def refused_at(part, scale: tuple[float, float, float]) -> None:
    """Note what dressing says while an object has another scale."""
    kept = tuple(part.scale)
    part.scale = scale
    bpy.context.view_layer.update()
    refused()
    part.scale = kept
    bpy.context.view_layer.update()


def scene_now() -> list[object]:
    """What a command that fails or is taken back leaves as it was."""
    kinds = ("objects", "meshes", "node_groups")
    return [
        *(len(getattr(bpy.data, kind)) for kind in kinds),
        [modifier.type for modifier in skirt.modifiers],
        [group.name for group in skirt.vertex_groups],
        skirt.display_type,
        armature.uvcloth.file,
    ]


def driven(command, events, killed=False, quality="fast") -> list[object]:
    """Run the modal code of an operator by made-up events; returns what it answers and reports."""
    from bl_ext.user_default.uvcloth.errands import LaboratoryOperator

    reports: list[str] = []
    ended: list[str] = []
    operator = type("Driven", (LaboratoryOperator,), {"begin": command.begin, "finish": command.finish})()
    operator.quality = quality
    operator.report = lambda kind, text: reports.append(f"{min(kind)}: {text}")
    manager = SimpleNamespace(
        event_timer_add=lambda seconds, window: "timer",
        event_timer_remove=ended.append,
        modal_handler_add=lambda _operator: True,
    )
    workspace = SimpleNamespace(status_text_set=lambda text: ended.append(text) if text is None else None)
    names = ("view_layer", "scene", "preferences", "active_object", "selected_objects")
    context = SimpleNamespace(
        window_manager=manager,
        workspace=workspace,
        window=None,
        evaluated_depsgraph_get=bpy.context.evaluated_depsgraph_get,
        **{name: getattr(bpy.context, name) for name in names},
    )
    answers = [operator.invoke(context, None)]
    if killed:
        operator._errand.laboratory._process.kill()
        operator._errand.laboratory._process.wait()
    while answers[-1] & {"RUNNING_MODAL", "PASS_THROUGH"}:
        kind = events.pop(0) if events else "TIMER"
        answers.append(operator.modal(context, SimpleNamespace(type=kind)))
    return [min(answers[0]), min(answers[-1]), reports, ended]


bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.extensions.package_install_files(filepath=str(EXTENSION), repo="user_default", enable_on_install=True)
preferences = bpy.context.preferences.addons["bl_ext.user_default.uvcloth"].preferences
from bl_ext.user_default.uvcloth import dressing, fitting, laboratory, live, posing, sending  # noqa: E402

scene = bpy.context.scene
scene.render.fps = 30
bpy.ops.import_scene.gltf(filepath=str(BAKED))
bpy.data.objects.remove(bpy.data.objects["dress"])
armature, body = bpy.data.objects["Armature"], bpy.data.objects["body"]
names_of_bones = {bone.name: f"knochen.{number:03}" for number, bone in enumerate(armature.data.bones)}
for bone in armature.data.bones:
    bone.name = names_of_bones[bone.name]


def brought(path: Path):
    """A garment of a file, on the armature."""
    bpy.ops.wm.obj_import(filepath=str(path), forward_axis="Y", up_axis="Z")
    part = bpy.context.selected_objects[0]
    part.parent = armature
    return part


skirt, tops = brought(SKIRT), brought(TOPS)
below = skirt.modifiers.new("round", "SUBSURF")
below.levels = 0
armature.rotation_mode = "XYZ"
armature.location, armature.rotation_euler = (2.0, 1.0, 0.0), (0.0, 0.0, 0.5)
armature.scale = (100.0, 100.0, 100.0)
skirt.data.vertices.foreach_set("co", (vertices(skirt) / SKIRT_SCALE).astype(np.float32).ravel())
skirt.data.flip_normals()
skirt.scale = SKIRT_SCALE
bpy.context.view_layer.update()

bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "scene.blend"))
select(armature)
refused()  # Nothing to wear.
select(skirt, armature)
refused()  # No laboratory.
preferences.python = str(FOLDER / "nowhere")
refused()  # None that runs.
preferences.python = sys.executable
refused()  # One without uvcloth.
for name, line in (
    ("other", """echo '{"uvcloth": "9.0", "protocol": 9}'; cat > /dev/null"""),
    ("older", """echo "argument: invalid choice: 'serve'" >&2; exit 2"""),
):
    (FOLDER / name).write_text(f"#!/bin/sh\n{line}\n", encoding="utf-8")
    (FOLDER / name).chmod(0o755)
    preferences.python = str(FOLDER / name)
    refused()
preferences.python = str(PYTHON)
body.hide_set(True)
refused()  # No skin.
body.hide_set(False)
refused_at(armature, (-2.0, 2.0, 2.0))
refused_at(armature, (2.0, 3.0, 2.0))
refused_at(skirt, (0.0, 1.0, 1.0))
armature.hide_set(True)
refused()
armature.hide_set(False)
elsewhere = bpy.data.collections.new("elsewhere")
elsewhere.objects.link(skirt)
scene.collection.objects.unlink(skirt)
refused()  # In a collection that is not in the scene.
scene.collection.children.link(elsewhere)
settings = armature.uvcloth
pinned = skirt.vertex_groups.new(name="pinned")
settings.garments[0].pins = "pinned"
refused()  # No vertex is pinned.
settings.garments[0].pins = ""
settings.garments[0].bone = "Nose"
refused()  # No such bone.
settings.garments[0].bone = ""
skirt.vertex_groups.remove(pinned)
said["untouched"] = [modifier.type for modifier in skirt.modifiers], armature.uvcloth.file

# Stopped, and killed, in the middle: the scene is as it was.
before = scene_now()
said["stopped"] = driven(fitting.Fit, ["MOUSEMOVE", "TIMER", "ESC"])
said["killed"] = driven(dressing.Dress, ["TIMER"], killed=True)
said["left"] = [before, scene_now()]

# A skirt in the hips: marked, shown as it would be, taken back, accepted.
made = vertices(skirt)
sunk = made.copy()
sunk[:, :2] -= 0.03 * sunk[:, :2] / np.linalg.norm(sunk[:, :2], axis=1, keepdims=True)
skirt.data.vertices.foreach_set("co", sunk.ravel())
bpy.ops.uvcloth.check()
group = skirt.vertex_groups.get(fitting.MARK)
said["marked"] = [
    sum(any(entry.group == group.index for entry in vertex.groups) for vertex in skirt.data.vertices),
    sum(vertex.select for vertex in skirt.data.vertices),
]
skirt.vertex_groups.remove(group)
before = scene_now()
said["fitted"] = driven(fitting.Fit, [])
said["previews"] = [part.name for part in bpy.data.objects if part.name.endswith(" fit")]
said["wire"] = skirt.display_type
bpy.ops.uvcloth.take_back_fit()
said["taken_back"] = [before, scene_now(), bool((vertices(skirt) == sunk).all())]
bpy.ops.uvcloth.fit()
preview = vertices(bpy.data.objects["skirt fit"])
bpy.ops.uvcloth.accept_fit()
said["accepted"] = [bool((vertices(skirt) == preview).all()), scene_now() == before]
bpy.ops.uvcloth.check()
said["clean"] = fitting.MARK not in skirt.vertex_groups
skirt.data.vertices.foreach_set("co", made.ravel())

# Two garments, the top tucked into the skirt whatever the order; the skirt pinned by its waist.
select(tops, armature)
bpy.ops.uvcloth.put_on()
settings.active = 1
bpy.ops.uvcloth.move_garment(outwards=False)
said["order"] = [entry.part.name for entry in settings.garments]
bpy.ops.uvcloth.move_garment(outwards=True)
settings.garments[1].into = skirt
settings.garments[0].fabric = "denim"
waist = skirt.vertex_groups.new(name="waist")
waist.add(np.flatnonzero(made[:, 2] > made[:, 2].max() - 0.03).tolist(), 1.0, "REPLACE")
settings.garments[0].pins = "waist"
skins = sending.skin_meshes(bpy.context, armature)
for bone in ("LeftArm", "Spine"):
    near = sending.near_bone(tops, armature, skins, names_of_bones[bone])
    arrays[f"near_{bone}"] = vertices(tops)[near]
armature.pose.bones[0].location = armature.pose.bones[0].location  # Posed, not at rest, while it is sent.
said["names"] = sending.plain_names(["a 2", "a", "a", "A 3", "."])
skirt.hide_viewport = elsewhere.hide_viewport = True
armature.location.x += 50.0
bpy.context.view_layer.update()
said["dressed"] = driven(dressing.Dress, ["MOUSEMOVE"])
skirt.hide_viewport = elsewhere.hide_viewport = False
bpy.context.view_layer.update()
said["rows"] = [[entry.part.name, entry.row] for entry in settings.garments]
said["modifiers"] = [modifier.type for modifier in skirt.modifiers]
said["file"] = armature.uvcloth.file
near = {}
for frame in range(31):
    scene.frame_set(frame)
    if frame in (0, 30):
        near[frame] = [distances(part, body) for part in (skirt, tops)]
said["fault"] = live.FAULTS.get(armature.session_uid, "")
for frame, name in ((0, "first"), (30, "last")):
    arrays[f"skirt_{name}"], arrays[f"tops_{name}"] = near[frame]

# An arm is raised while the timeline stands: cloth follows, and frames come back as they were.
played = [np.array(live.surface.places(part)) for part in (skirt, tops)]
graph = bpy.context.evaluated_depsgraph_get
posing.step(armature, scene, graph())
said["stands"] = posing.step(armature, scene, graph())
arm = armature.pose.bones[names_of_bones["LeftArm"]]
arm.rotation_quaternion = arm.rotation_quaternion @ Quaternion((1.0, 0.0, 0.0), 0.5)
bpy.context.view_layer.update()
steps = 0
while posing.step(armature, scene, graph()):
    steps += 1
said["steps"] = steps
arrays["posed"] = np.linalg.norm(live.surface.places(tops) - played[1], axis=1)
scene.frame_set(29)
scene.frame_set(30)
arrays["back"] = live.surface.places(tops) - played[1]

# A garment that is taken off leaves the other live.
settings.active = 0
bpy.ops.uvcloth.take_off()
scene.frame_set(5)
said["taken_off"] = [
    [modifier.type for modifier in skirt.modifiers],
    live.FAULTS.get(armature.session_uid, ""),
    settings.live,
]

# To a file, with the motion of some frames.
select(armature)
scene.frame_start, scene.frame_end = 3, 12
before = scene_now()
said["to_file"] = driven(dressing.BakeToFile, [], quality="fast")
said["to_file_left"] = [before, scene_now()]

# With wrinkles, a T-shirt of a template is shown by a finer copy, below the same modifiers.
tops.data.materials.append(bpy.data.materials.new("red"))
tops.modifiers.new("round", "SUBSURF").levels = 0
objects = sorted(part.name for part in bpy.data.objects)
select(armature)
said["wrinkled"] = driven(dressing.Dress, [], quality="wrinkles")
(entry,) = settings.garments
copy = entry.finer
scene.frame_set(6)
said["finer"] = [
    *(len(part.data.vertices) for part in (tops, copy)),
    [modifier.type for modifier in copy.modifiers],
    [copy.data.materials[0].name, len(copy.data.uv_layers)],
    [tops.hide_get(), tops.hide_render, armature.uvcloth.live, live.FAULTS.get(armature.session_uid, "")],
    [part.name for part in sending.skin_meshes(bpy.context, armature)],
]
arrays["finer"] = distances(copy, body)
bpy.ops.uvcloth.take_off()
said["dropped"] = [
    tops.hide_get(),
    tops.hide_render,
    sorted(part.name for part in bpy.data.objects) == objects,
]

process = laboratory._Kept.laboratory._process
bpy.ops.preferences.addon_disable(module="bl_ext.user_default.uvcloth")
said["child_left"] = process.poll() is None
np.savez(FOLDER / "arrays.npz", **arrays)
(FOLDER / "said.json").write_text(json.dumps(said), encoding="utf-8")
sys.stdout.flush()
os._exit(0)  # Blender 4.2 by itself crashes at the end of a Python in which its glTF exporter ran.
