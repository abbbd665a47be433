"""Dressing: a character and garment meshes of the scene, baked in the laboratory, go live as they are."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from uvcloth_core.baked import BakedFile, BakedGarment

from . import live, opening, sending, surface
from .laboratory import Child
from .preferences import python_of
from .rig import match_bones

FOLDER = "uvcloth_baked"
"""Folder of baked files beside the .blend."""

LOOKS = 0.2
"""Seconds from one look at the child to the next."""


@dataclass(frozen=True)
class Bake:
    """A bake that runs: who is dressed, in what, the child, its files, and where the result goes.

    rest: (4, 4) of the armature to the world, as it was sent.
    """

    armature: Any
    garments: Sequence[Any]
    rest: np.ndarray
    child: Child
    folder: tempfile.TemporaryDirectory
    path: Path


class Dress(bpy.types.Operator):
    """Bake the selected meshes as clothes of the active armature, in the order of their names; Esc stops"""

    bl_idname = "uvcloth.dress"
    bl_label = "Dress"
    bl_options = {"UNDO"}  # noqa: RUF012

    quality: bpy.props.EnumProperty(
        name="Quality",
        items=[(name, name.title(), "") for name in ("fast", "default", "fine")],
        default="default",
    )

    _timer: Any = None
    _bake: Bake | None = None

    def execute(self, context: Any) -> set[str]:
        """Bake, and wait for it."""
        try:
            bake = begin(context, self.quality)
            bake.child.wait()
            finish(context, bake)
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Bake beside Blender, and look at it from time to time."""
        try:
            self._bake = begin(context, self.quality)
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._timer = context.window_manager.event_timer_add(LOOKS, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Show what the child says, until it ends or is stopped."""
        assert self._bake is not None
        if event.type == "ESC":
            self._bake.child.kill()
            self._bake.folder.cleanup()
            return self._end(context, "CANCELLED")
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if not self._bake.child.is_done():
            context.workspace.status_text_set(
                f"uvcloth: {self._bake.child.last_line() or 'baking'} (Esc stops)"
            )
            return {"RUNNING_MODAL"}
        try:
            finish(context, self._bake)
        except (ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return self._end(context, "CANCELLED")
        return self._end(context, "FINISHED")

    def _end(self, context: Any, how: str) -> set[str]:
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)
        return {how}


def begin(context: Any, quality: str) -> Bake:
    """Write the files of the selection, and begin the child. Raises ValueError in a sentence."""
    armature = context.view_layer.objects.active
    if armature is None or armature.type != "ARMATURE":
        raise ValueError("select garment meshes, then the armature, which has to be the active object")
    garments = sorted(
        (part for part in context.selected_objects if part.type == "MESH"), key=lambda p: p.name
    )
    if not garments:
        raise ValueError(f"select the garment meshes too, beside {armature.name}")
    python = python_of(context)
    if not bpy.data.filepath:
        raise ValueError("save the .blend first: baked files are written beside it")
    for garment in garments:
        surface.place_of_cloth(garment)
        if garment.data.users > 1:
            raise ValueError(f"the mesh of {garment.name} is used by others too: make it single-user")
    skins = sending.skin_meshes(context, armature, garments)
    folder = tempfile.TemporaryDirectory(prefix="uvcloth-dress-")
    try:
        place = Path(folder.name)
        sending.write_character(context, armature, skins, place / "character.glb")
        files = [place / f"garment{index:02d}.obj" for index in range(len(garments))]
        for garment, file in zip(garments, files, strict=True):
            sending.write_garment(garment, armature, file)
        name = bpy.path.clean_name(f"{Path(bpy.data.filepath).stem}-{armature.name}")
        path = Path(bpy.path.abspath(f"//{FOLDER}")) / f"{name}.glb"
        arguments: list[str | Path] = [
            "bake",
            "--body",
            place / "character.glb",
            "--garment",
            *files,
            "--quality",
            quality,
        ]
        child = Child(python, [*arguments, "--out", place / "baked.glb"], place / "log.txt")
    except BaseException:
        folder.cleanup()
        raise
    return Bake(armature, garments, np.array(armature.matrix_world, np.float64), child, folder, path)


def finish(context: Any, bake: Bake) -> None:
    """Make the garments live, from what the child wrote. Raises ValueError; they are not live then."""
    with bake.folder as place:
        bake.child.require_success()
        written = Path(place) / "baked.glb"
        baked, _ = live.open_outfit(written)
        if len(baked.garments) != len(bake.garments):
            raise baked.file.error(f"{len(baked.garments)} garments came of {len(bake.garments)} meshes")
        for part, garment in zip(bake.garments, baked.garments, strict=True):
            require_order(part, baked, garment)
        names = opening.bone_names(baked)
        bones = bake.armature.data.bones
        if missing := [name for name in names if name not in bones]:
            raise ValueError(f"bone {missing[0]} of {bake.armature.name} has another name in glTF")
        poses = np.array([bones[name].matrix_local for name in names], np.float64)
        rig = match_bones(names, bake.rest, poses, [next(opening.poses_of_file(baked, 0.0))])
        bake.path.parent.mkdir(parents=True, exist_ok=True)
        bake.path.write_bytes(written.read_bytes())
    settings = bake.armature.uvcloth
    settings.live = False
    settings.garments.clear()
    for part in bake.garments:
        surface.put_source(part.data, np.arange(len(part.data.vertices)))
        settings.garments.add().part = part
    opening.keep_bones(bake.armature, rig)
    settings.file = bpy.path.relpath(str(bake.path))
    settings.live = True
    context.scene.render.use_lock_interface = True
    if fault := live.FAULTS.get(bake.armature.session_uid):
        raise ValueError(fault)


def require_order(part: Any, baked: BakedFile, garment: BakedGarment) -> None:
    """Raise ValueError unless vertices of a mesh are those of a baked garment, in order: its edges are."""
    mesh, file = part.data, baked.file
    reason = f"{part.name} was repaired when it was baked, and its vertices are not the mesh's any more"
    if garment.size != len(mesh.vertices):
        raise ValueError(f"{reason}: merge doubled vertices and delete loose ones first")
    node = file.entries("nodes")[garment.node]
    corners = [
        garment.vertices[file.array(primitive["indices"], "SCALAR")[:, 0]].reshape(-1, 3)
        for primitive in file.entries("meshes")[node["mesh"]]["primitives"]
    ]
    sides = np.concatenate([np.roll(faces, turn, 1)[:, :2] for faces in corners for turn in range(3)])
    edges = np.empty(2 * len(mesh.edges), np.int32)
    mesh.edges.foreach_get("vertices", edges)
    known, asked = (np.sort(each.reshape(-1, 2), 1) @ [garment.size, 1] for each in (sides, edges))
    if not np.isin(asked, known).all():
        raise ValueError(f"{reason}: delete inverted and empty faces first")
