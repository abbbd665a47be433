"""Run by a Python that has bpy: python in_blender.py EXTENSION.zip BAKED.glb FOLDER

Does in Blender what an artist would, and writes what came of it to FOLDER/arrays.npz and FOLDER/said.json.
"""

import json
import os
import signal
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np

try:
    import resource
except ImportError:  # Not on Windows.
    resource = None

FRAMES = range(10)
EXTENSION, BAKED, FOLDER = (Path(each) for each in sys.argv[1:])
MODULE = "bl_ext.user_default.uvcloth"
arrays: dict[str, np.ndarray] = {}
said: dict[str, object] = {}


def evaluated(part) -> np.ndarray:
    """Vertices (V, 3) of an object in the world, as they are drawn."""
    drawn = part.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = drawn.to_mesh()
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    drawn.to_mesh_clear()
    world = np.array(drawn.matrix_world)
    return points.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]


def played(frames) -> np.ndarray:
    """Vertices (F, V, 3) of the dress at frames."""
    vertices = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        vertices.append(evaluated(bpy.data.objects["dress"]))
    return np.stack(vertices)


def sentence(path: Path) -> str:
    """What opening a file says."""
    try:
        bpy.ops.uvcloth.open_baked(filepath=str(path))
    except RuntimeError as error:
        return str(error).strip()
    return ""


def counts() -> list[int]:
    """Numbers of data of some kinds."""
    return [
        len(getattr(bpy.data, kind)) for kind in ("objects", "meshes", "armatures", "actions", "materials")
    ]


def fault() -> str:
    """What the panel shows of the armature."""
    from bl_ext.user_default.uvcloth import live

    return live.FAULTS.get(bpy.data.objects["Armature"].session_uid, "")


bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.extensions.package_install_files(filepath=str(EXTENSION), repo="user_default", enable_on_install=True)
said["registered"] = hasattr(bpy.types.Object, "uvcloth")
bpy.ops.preferences.addon_disable(module=MODULE)
said["unregistered"] = not hasattr(bpy.types.Object, "uvcloth") and not hasattr(
    bpy.types, "VIEW3D_PT_uvcloth"
)
bpy.ops.preferences.addon_enable(module=MODULE)

from bl_ext.user_default.uvcloth import cache, environment, live, surface  # noqa: E402

# A Python with uvcloth is made from a folder of wheels, or not at all.
preferences = bpy.context.preferences.addons[MODULE].preferences
said["environments"] = []
for preferences.wheels in ("", str(FOLDER / "nowhere"), str(FOLDER), str(FOLDER / "wheels")):
    try:
        bpy.ops.uvcloth.make_environment()
        said["environments"].append(preferences.python)
    except RuntimeError as error:
        said["environments"].append(str(error).strip())
preferences.python = ""
bpy.ops.uvcloth.copy_command()
said["command"] = environment.command_line(environment.commands_in(environment.environment_folder()))
said["will_be"] = preferences.python

before = counts()
said["refused"] = {
    path.stem: sentence(path) for path in [*sorted(FOLDER.glob("bad_*.glb")), FOLDER / "missing.glb"]
}
said["left"] = [before, counts()]

bpy.ops.uvcloth.open_baked(filepath=str(BAKED))
scene, armature, dress = bpy.context.scene, bpy.data.objects["Armature"], bpy.data.objects["dress"]
said["frames"] = [scene.render.fps, scene.frame_start, scene.frame_end]
said["modifiers"] = [modifier.type for modifier in dress.modifiers]
said["uv"] = len(dress.data.uv_layers)
rest = np.empty(3 * len(dress.data.vertices), np.float32)
dress.data.vertices.foreach_get("co", rest)

arrays["source"] = surface.source_of(dress)
arrays["played"] = played(FRAMES)
moments = live.SESSIONS[armature.session_uid].timeline._moments
arrays["joints"] = np.stack([moment.joints for moment in moments])
arrays["scrubbed"] = played([3, 0, 9, 5])

# A render gets what was played, frame after frame and from the middle.
rendered = []
bpy.app.handlers.render_post.append(lambda _scene, _graph: rendered.append(surface.places(dress)))
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
scene.collection.objects.link(camera)
scene.camera, scene.render.engine, scene.cycles.samples = camera, "CYCLES", 1
scene.render.resolution_x = scene.render.resolution_y = 8
scene.render.filepath = str(FOLDER / "frame")
end, scene.frame_start, scene.frame_end = scene.frame_end, 4, 6
bpy.ops.render.render(animation=True)
scene.frame_start, scene.frame_end = 0, end
arrays["rendered"] = np.stack(rendered)
bpy.app.handlers.render_post.clear()

# The unit in which lengths are shown moves no cloth.
scene.unit_settings.scale_length, scene.unit_settings.length_unit = 0.01, "CENTIMETERS"
live.SESSIONS.clear()
arrays["in_centimetres"] = played(FRAMES)
scene.unit_settings.scale_length = 1.0

# Other rates are other steps.
for fps in (24, 60):
    scene.render.fps = fps
    arrays[f"at_{fps}"] = played(range(4))
    moments = live.SESSIONS[armature.session_uid].timeline._moments
    arrays[f"joints_{fps}"] = np.stack([moment.joints for moment in moments])
scene.render.fps = 30

# Undo takes back what was done, and cloth goes on.
bpy.ops.ed.undo_push(message="before")
armature.location = (5.0, 0.0, 0.0)
bpy.ops.ed.undo_push(message="moved")
scene.frame_set(3)
bpy.ops.ed.undo()
scene, armature, dress = bpy.context.scene, bpy.data.objects["Armature"], bpy.data.objects["dress"]
said["undone"] = list(armature.location)
arrays["undone"] = played(FRAMES)

# An armature that is moved, turned and scaled.
armature.location, armature.scale = (3.0, -2.0, 1.0), (2.0, 2.0, 2.0)
armature.rotation_mode = "XYZ"
armature.rotation_euler = (0.0, 0.0, 0.7)
arrays["moved"] = played(FRAMES)
arrays["place"] = np.array(armature.matrix_world)

# Between frames, as motion blur asks, without a trace in the frames.
armature.location, armature.scale, armature.rotation_euler = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
played(FRAMES)
scene.frame_set(5, subframe=0.5)
arrays["between"] = evaluated(dress)
arrays["after_between"] = played([5, 6])
armature.location, armature.scale, armature.rotation_euler = (
    (3.0, -2.0, 1.0),
    (2.0, 2.0, 2.0),
    (0.0, 0.0, 0.7),
)
played(FRAMES)

# A scale that no cloth is solved at leaves the cloth where it was.
here = surface.places(dress)
armature.scale = (-2.0, 2.0, 2.0)
scene.frame_set(9)
said["negative"] = fault()
armature.scale = (2.0, 3.0, 2.0)
scene.frame_set(9)
said["uneven"] = fault()
armature.scale = (2.0, 2.0, 2.0)
bone = armature.pose.bones[5]
bone.scale = (1.2, 1.0, 1.0)
scene.frame_set(9)
said["scaled_bone"] = [bone.name, fault()]
bone.scale = (1.0, 1.0, 1.0)
name, bone.name = bone.name, "another"
scene.frame_set(9)
said["gone_bone"] = [name, fault()]
bone.name = name
joint = armature.uvcloth.bones[-1]
kept = joint.bone, joint.to_node[:]
armature.uvcloth.bones.remove(len(armature.uvcloth.bones) - 1)  # As after a bake of another skeleton.
scene.frame_set(9)
said["other_skeleton"] = fault()
joint = armature.uvcloth.bones.add()
joint.bone, joint.to_node = kept
said["stayed"] = bool((surface.places(dress) == here).all())
armature.location, armature.scale, armature.rotation_euler = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)

# Saved, and opened again, it plays the same.
said["unsaved"] = ""
try:
    bpy.ops.uvcloth.cache()
except RuntimeError as error:
    said["unsaved"] = str(error).strip()
bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "scene.blend"))
bpy.ops.wm.open_mainfile(filepath=str(FOLDER / "scene.blend"))
arrays["reloaded"] = played(FRAMES)

# A cache that is stopped, or does not fit on the disk, leaves nothing, and the cloth live.
scene, armature, dress = bpy.context.scene, bpy.data.objects["Armature"], bpy.data.objects["dress"]
scene.frame_end = FRAMES[-1]
bpy.context.view_layer.objects.active = dress


def driven_cache(events) -> list[object]:
    """Run the modal code of Cache by made-up events; returns its answers, its reports, and what is left."""
    reports: list[str] = []
    operator = SimpleNamespace(report=lambda kind, text: reports.append(f"{min(kind)}: {text}"))
    operator._end = partial(cache.WriteCache._end, operator)
    nothing = lambda *_arguments, **_options: None  # noqa: E731
    names = ("event_timer_add", "event_timer_remove", "progress_begin", "progress_update", "progress_end")
    manager = SimpleNamespace(modal_handler_add=nothing, **dict.fromkeys(names, nothing))
    context = SimpleNamespace(window_manager=manager, window=None, scene=scene, active_object=dress)
    answers = [cache.WriteCache.invoke(operator, context, None)]
    while answers[-1] & {"RUNNING_MODAL", "PASS_THROUGH"}:
        event = SimpleNamespace(type=events.pop(0) if events else "TIMER")
        answers.append(cache.WriteCache.modal(operator, context, event))
    left = list((FOLDER / cache.FOLDER).iterdir()) if (FOLDER / cache.FOLDER).exists() else []
    return [[min(answer) for answer in answers], reports, len(left), armature.uvcloth.live]


said["cache_stopped"] = driven_cache(["TIMER", "MOUSEMOVE", "TIMER", "ESC"])
if resource is not None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    said["cache_full"] = driven_cache([])
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)

# A cache of one frame: Blender has no scene with less.
scene.frame_start, scene.frame_end = 5, 0
said["fewest_frames"] = [scene.frame_start, scene.frame_end]
scene.frame_start = scene.frame_end = 5
bpy.ops.uvcloth.cache()
arrays["one_cached"] = played([5])
bpy.ops.uvcloth.drop_cache()
scene.frame_start, scene.frame_end, armature.uvcloth.live = FRAMES[0], FRAMES[-1], True
played(FRAMES)

# A cache plays it without the runtime.
bpy.ops.uvcloth.cache()
said["live"] = armature.uvcloth.live
said["cached_modifiers"] = [modifier.type for modifier in dress.modifiers]
arrays["cached"] = played([*FRAMES])
after = np.empty(3 * len(dress.data.vertices), np.float32)
dress.data.vertices.foreach_get("co", after)
said["mesh_kept"] = bool((after == rest).all()) and surface.PLACES not in dress.data.attributes
bpy.ops.uvcloth.drop_cache()
said["dropped_modifiers"] = [modifier.type for modifier in dress.modifiers]

# The file of the bake is gone.
armature.uvcloth.file = str(FOLDER / "missing.glb")
armature.uvcloth.live = True
said["gone"] = [fault(), armature.uvcloth.live]

# A file without a motion leaves the scene its frames.
frames = [scene.render.fps, scene.frame_start, scene.frame_end]
known = set(live.characters())
said["still"] = sentence(FOLDER / "still.glb")
said["still_frames"] = [frames, [scene.render.fps, scene.frame_start, scene.frame_end]]
(still,) = set(live.characters()) - known
said["still_live"] = [still.uvcloth.live, live.FAULTS.get(still.session_uid, "")]

np.savez(FOLDER / "arrays.npz", **arrays)
(FOLDER / "said.json").write_text(json.dumps(said), encoding="utf-8")
sys.stdout.flush()
os._exit(0)  # Blender 4.2 by itself crashes at the end of a Python in which its glTF exporter ran.
