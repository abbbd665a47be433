"""Opening a baked character: Blender imports the glTF, then its garments go live."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bmesh
import bpy
import numpy as np
from bpy_extras.io_utils import ImportHelper
from numpy.typing import NDArray
from uvcloth_core.animation import sampled_worlds
from uvcloth_core.baked import BakedFile, BakedGarment
from uvcloth_core.nodes import chain, local_transform, parents_first, worlds

from . import live, surface
from .rig import Rig, match_bones

COLLECTIONS = (
    "objects",
    "meshes",
    "armatures",
    "materials",
    "images",
    "actions",
    "collections",
    "node_groups",
)
"""Kinds of data that an import makes."""

LONGEST_BONE = 63
"""Bytes of a bone's name."""

TRIANGLES = 4
"""Mode of primitives that Blender imports as faces."""


class OpenBaked(bpy.types.Operator, ImportHelper):
    """Open a character that uvcloth baked; its clothes move with the timeline"""

    bl_idname = "uvcloth.open_baked"
    bl_label = "Open a Baked Character"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012
    filename_ext = ".glb"
    filter_glob: bpy.props.StringProperty(default="*.glb", options={"HIDDEN"})
    set_frames: bpy.props.BoolProperty(
        name="Set frames",
        default=True,
        description="Give the scene the frame rate and the frames of the file's animation",
    )

    def execute(self, context: Any) -> set[str]:
        """Import the file; what goes wrong leaves the scene as it was."""
        try:
            armature = open_character(context, Path(self.filepath), self.set_frames)
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        names = ", ".join(entry.part.name for entry in armature.uvcloth.garments)
        self.report({"INFO"}, f"{armature.name}: live are {names}")
        return {"FINISHED"}


def open_character(context: Any, path: Path, set_frames: bool) -> Any:
    """Import a baked file and make its garments live; returns the armature.

    Raises ValueError naming the file, and leaves the scene as it was, if it has no cloth or cannot be
    imported.
    """
    baked, _ = live.open_outfit(path)
    with _undone(context.scene) as made:
        if set_frames:
            _set_frames(context.scene, baked)
        options = {"filepath": str(path), "bone_heuristic": "BLENDER", "disable_bone_shape": True}
        known = bpy.ops.import_scene.gltf.get_rna_type().properties.keys()
        try:
            bpy.ops.import_scene.gltf(**{name: value for name, value in options.items() if name in known})
        except RuntimeError as error:
            raise baked.file.error(f"Blender cannot import it ({error})") from error
        objects = made("objects")
        armature = _armature(baked, objects)
        settings = armature.uvcloth
        for row, garment in enumerate(baked.garments):
            part = _part(baked, garment, objects)
            surface.put_source(part.data, imported_vertices(baked, garment))
            weld(part.data)
            entry = settings.garments.add()
            entry.part, entry.row = part, row
        _find_bones(context, baked, armature)
        settings.file = str(path)
        settings.live = True
        if fault := live.FAULTS.get(armature.session_uid):
            raise ValueError(fault)
        # The interface must not draw a mesh that a render is writing.
        context.scene.render.use_lock_interface = True
        return armature


@contextmanager
def _undone(scene: Any) -> Iterator[Any]:
    """Give a function of what was made since, by the kind of data; a ValueError takes all that away again."""
    before = {name: set(getattr(bpy.data, name)) for name in COLLECTIONS}
    kept = scene.render.fps, scene.render.fps_base, scene.frame_start, scene.frame_end, scene.frame_current

    def made(name: str) -> list[Any]:
        return [each for each in getattr(bpy.data, name) if each not in before[name]]

    try:
        yield made
    except ValueError:
        for name in COLLECTIONS:
            bpy.data.batch_remove(made(name))
        scene.render.fps, scene.render.fps_base, scene.frame_start, scene.frame_end, frame = kept
        scene.frame_set(frame)
        raise


def _set_frames(scene: Any, baked: BakedFile) -> None:
    """Give the scene the rate and the frames of the first animation, where the file has one."""
    if baked.file.entries("animations"):
        motion = baked.motion()
        scene.render.fps, scene.render.fps_base = round(motion.fps), 1.0
        scene.frame_start = round(motion.times[0] * motion.fps)
        scene.frame_end = scene.frame_start + len(motion.times) - 1


def _armature(baked: BakedFile, objects: list[Any]) -> Any:
    """The imported armature with a bone for every joint. Raises ValueError."""
    names = set(bone_names(baked))
    for each in objects:
        if each.type == "ARMATURE" and names <= set(each.data.bones.keys()):
            return each
    raise baked.file.error("its joints have not become bones of one armature")


def bone_names(baked: BakedFile) -> list[str]:
    """Names of the bones that become of a file's joints.

    Raises ValueError for joints without names, or with the same.
    """
    nodes = baked.file.entries("nodes")
    names = [str(nodes[node].get("name", ""))[:LONGEST_BONE] for node in baked.skin.nodes]
    if not all(names) or len(set(names)) < len(names):
        raise baked.file.error("joints of its cloth have no names, or the same")
    return names


def _part(baked: BakedFile, garment: BakedGarment, objects: list[Any]) -> Any:
    """The imported object of a garment. Raises ValueError."""
    for each in objects:
        # Blender puts a number behind a name that there is already.
        if each.type == "MESH" and garment.name in (each.name, each.name.rpartition(".")[0]):
            return each
    raise baked.file.error(f"{garment.name}, a garment of its cloth, has not become an object")


def imported_vertices(baked: BakedFile, garment: BakedGarment) -> NDArray[np.int64]:
    """The runtime's vertex of each vertex that Blender imports: those of a primitive's faces, in order."""
    file = baked.file
    mesh = file.entries("meshes")[file.entries("nodes")[garment.node]["mesh"]]
    used = [
        np.unique(file.array(primitive["indices"], "SCALAR")[:, 0])
        if "indices" in primitive
        else np.arange(len(garment.vertices))
        for primitive in mesh["primitives"]
        if primitive.get("mode", TRIANGLES) == TRIANGLES
    ]
    return garment.vertices[np.concatenate(used)]


def weld(mesh: Any) -> None:
    """Make vertices of a mesh that are one vertex of the runtime one: glTF repeats them on texture seams."""
    work = bmesh.new()
    work.from_mesh(mesh)
    layer = work.verts.layers.int[surface.SOURCE]
    first: dict[int, Any] = {}
    same = {}
    for vertex in work.verts:
        other = first.setdefault(vertex[layer], vertex)
        if other is not vertex:
            same[vertex] = other
    bmesh.ops.weld_verts(work, targetmap=same)
    work.to_mesh(mesh)
    work.free()
    # Normals of corners were kept for the repeated vertices; the faces' own are smooth there.
    normals = mesh.attributes.get("custom_normal")
    if normals is not None:
        mesh.attributes.remove(normals)


def _find_bones(context: Any, baked: BakedFile, armature: Any) -> None:
    """Find how bones lie against joints: by the pose of the first frame, which is one of the file's."""
    scene = context.scene
    scene.frame_set(scene.frame_start)
    evaluated = armature.evaluated_get(context.evaluated_depsgraph_get())
    names = bone_names(baked)
    seconds = scene.frame_start * scene.render.fps_base / scene.render.fps
    rig = match_bones(
        names,
        np.array(evaluated.matrix_world, np.float64),
        live.poses_of(evaluated, tuple(names)),
        list(poses_of_file(baked, seconds)),
    )
    keep_bones(armature, rig)


def keep_bones(armature: Any, rig: Rig) -> None:
    """Keep a rig in an armature's settings."""
    settings = armature.uvcloth
    settings.size = rig.size
    settings.bones.clear()
    for name, to_node in zip(rig.bones, rig.to_nodes, strict=True):
        entry = settings.bones.add()
        entry.bone, entry.to_node = name, to_node.ravel().tolist()


def poses_of_file(baked: BakedFile, seconds: float) -> Iterator[NDArray[np.float64]]:
    """Transforms (J, 4, 4) of the joints to the scene of the file, at rest and in each of its animations."""
    file, joints = baked.file, baked.skin.nodes
    nodes = {node for joint in joints for node in (joint, *chain(joint, file.above))}
    local = {node: local_transform(file.entries("nodes")[node]) for node in nodes}
    at_rest = worlds(parents_first(nodes, file.above), file.above, local)
    yield np.stack([at_rest[joint] for joint in joints])
    for animation in file.entries("animations"):
        yield sampled_worlds(file, animation, joints, np.array([seconds]))[0]
