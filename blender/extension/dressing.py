"""Dressing: a character and garment meshes of the scene, baked in the laboratory, go live as they are."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from uvcloth_core.baked import BakedFile, BakedGarment

from . import errands, live, opening, surface
from .errands import Errand, LaboratoryOperator
from .rig import match_bones

FOLDER = "uvcloth_baked"
"""Folder of baked files beside the .blend."""


class Dress(LaboratoryOperator, bpy.types.Operator):
    """Bake the garments of the active armature, and meshes that are selected with it; Esc stops"""

    bl_idname = "uvcloth.dress"
    bl_label = "Dress"
    bl_options = {"UNDO"}  # noqa: RUF012

    quality: bpy.props.EnumProperty(
        name="Quality",
        items=[(name, name.title(), "") for name in ("fast", "default", "fine")],
        default="default",
    )

    def begin(self, context: Any) -> Errand:
        """Send the garments to be baked."""
        if not bpy.data.filepath:
            raise ValueError("save the .blend first: baked files are written beside it")
        return errands.begin(context, "bake", "baked.glb", "--on-character", "--quality", self.quality)

    def finish(self, context: Any, errand: Errand) -> None:
        """Make the garments live, from what the laboratory wrote; they are not live if this raises."""
        baked, _ = live.open_outfit(errand.result)
        rows = baked_rows(errand, baked.garments)
        for part, row in zip(errand.garments, rows, strict=True):
            require_order(part, baked, baked.garments[row])
        names = opening.bone_names(baked)
        bones = errand.armature.data.bones
        if missing := [name for name in names if name not in bones]:
            raise ValueError(f"bone {missing[0]} of {errand.armature.name} has another name in glTF")
        poses = np.array([bones[name].matrix_local for name in names], np.float64)
        rig = match_bones(names, errand.rest, poses, [next(opening.poses_of_file(baked, 0.0))])
        path = path_of(errand.armature)
        write_whole(path, errand.result.read_bytes())
        settings = errand.armature.uvcloth
        settings.live = False
        for entry in settings.garments:
            entry.row = rows[errand.garments.index(entry.part)] if entry.part in errand.garments else -1
        for part in errand.garments:
            surface.put_source(part.data, np.arange(len(part.data.vertices)))
        opening.keep_bones(errand.armature, rig)
        settings.file = bpy.path.relpath(str(path))
        settings.live = True
        context.scene.render.use_lock_interface = True
        if fault := live.FAULTS.get(errand.armature.session_uid):
            raise ValueError(fault)


def path_of(armature: Any) -> Path:
    """Where the baked file of an armature goes."""
    name = bpy.path.clean_name(f"{Path(bpy.data.filepath).stem}-{armature.name}")
    return Path(bpy.path.abspath(f"//{FOLDER}")) / f"{name}.glb"


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, or leave the one that is there. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    try:
        partial.write_bytes(content)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def baked_rows(errand: Errand, garments: Sequence[BakedGarment]) -> list[int]:
    """Place of each mesh among baked garments. Raises ValueError for a mesh of which several came."""
    names = [garment.name for garment in garments]
    for part, name in zip(errand.garments, errand.names, strict=True):
        if name not in names:
            raise ValueError(
                f"{part.name} holds several garments: separate them (in Edit Mode P, By Loose Parts)"
            )
    return [names.index(name) for name in errand.names]


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
