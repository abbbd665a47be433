"""Dressing: a character and garment meshes of the scene, baked in the laboratory, go live as they are."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from uvcloth_core.baked import BakedFile, BakedGarment

from . import errands, finer, live, opening, surface
from .errands import Errand, LaboratoryOperator, report_to
from .rig import match_bones

WRINKLES = "wrinkles"
"""Quality of which garments with a network have wrinkles: that of the cages of `default`."""

QUALITY = bpy.props.EnumProperty(
    name="Quality",
    items=[
        ("fast", "Fast", ""),
        ("default", "Default", ""),
        (
            WRINKLES,
            "Default, with Wrinkles",
            "T-shirts and shirts with the texture coordinates of uvcloth's own get finer copies with "
            "small folds",
        ),
        ("fine", "Fine", ""),
    ],
    default="default",
)

NO_WRINKLES = (
    "no garment has wrinkles: they are for T-shirts and shirts in jersey with the texture coordinates of "
    "uvcloth's templates"
)

FOLDER = "uvcloth_baked"
"""Folder of baked files beside the .blend."""


class Dress(LaboratoryOperator, bpy.types.Operator):
    """Bake the garments of the active armature, and meshes that are selected with it; Esc stops"""

    bl_idname = "uvcloth.dress"
    bl_label = "Dress"
    bl_options = {"UNDO"}  # noqa: RUF012

    quality: QUALITY

    def begin(self, context: Any) -> Errand:
        """Send the garments to be baked."""
        return bake(context, self.quality)

    def finish(self, context: Any, errand: Errand) -> None:
        """Make the garments live, from what the laboratory wrote; they are not live if this raises."""
        baked, _ = live.open_outfit(errand.result)
        rows = baked_rows(errand, baked.garments)
        middles = {
            part: require_order(part, baked, baked.garments[row])
            for part, row in zip(errand.garments, rows, strict=True)
        }
        names = opening.bone_names(baked)
        bones = errand.armature.data.bones
        if missing := [name for name in names if name not in bones]:
            raise ValueError(f"bone {missing[0]} of {errand.armature.name} has another name in glTF")
        poses = np.array([bones[name].matrix_local for name in names], np.float64)
        rig = match_bones(names, errand.rest, poses, [next(opening.poses_of_file(baked, 0.0))])
        path, copies = path_of(errand.armature), dict[Any, Any]()
        try:
            for part, ends in middles.items():
                if ends is not None:
                    copies[part] = finer.made(part, ends)
            write_whole(path, errand.result.read_bytes())
        except (ValueError, OSError):
            for copy in copies.values():
                finer.remove(copy)
            raise
        settings = errand.armature.uvcloth
        settings.live = False
        for entry in settings.garments:
            finer.drop(context, entry)
            entry.row = rows[errand.garments.index(entry.part)] if entry.part in errand.garments else -1
            if entry.part in copies:
                finer.show(entry, copies[entry.part])
            elif entry.row >= 0:
                surface.put_source(entry.part.data, np.arange(len(entry.part.data.vertices)))
        opening.keep_bones(errand.armature, rig)
        settings.file = bpy.path.relpath(str(path))
        settings.live = True
        context.scene.render.use_lock_interface = True
        if fault := live.FAULTS.get(errand.armature.session_uid):
            raise ValueError(fault)
        if self.quality == WRINKLES and not copies:
            report_to(self, [NO_WRINKLES], warns=True)


class BakeToFile(LaboratoryOperator, bpy.types.Operator):
    """Bake the garments with the motion of the scene's frames, for the web and engines; Esc stops"""

    bl_idname = "uvcloth.bake_to_file"
    bl_label = "Bake to File"

    quality: QUALITY

    def begin(self, context: Any) -> Errand:
        """Send the character with its motion, and the garments."""
        return bake(context, self.quality, moves=True)

    def finish(self, _context: Any, errand: Errand) -> None:
        """Write the file beside the .blend; the scene stays as it is."""
        path = path_of(errand.armature, folder="")
        write_whole(path, errand.result.read_bytes())
        report_to(self, [f"{path} holds the character in its clothes, with the scene's motion"], warns=False)


def bake(context: Any, quality: str, moves: bool = False) -> Errand:
    """Send the garments to be baked. moves: with the motion of the scene's frames.

    Raises ValueError in a sentence, and OSError.
    """
    if not bpy.data.filepath:
        raise ValueError("save the .blend first: baked files are written beside it")
    options = ("--quality", "default", "--wrinkles") if quality == WRINKLES else ("--quality", quality)
    return errands.begin(context, "bake", "baked.glb", "--on-character", *options, moves=moves)


def path_of(armature: Any, folder: str = FOLDER) -> Path:
    """Where the baked file of an armature goes, in a folder beside the .blend."""
    name = bpy.path.clean_name(f"{Path(bpy.data.filepath).stem}-{armature.name}")
    return Path(bpy.path.abspath(f"//{folder}")) / f"{name}.glb"


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


def require_order(part: Any, baked: BakedFile, garment: BakedGarment) -> finer.Ints | None:
    """Raise ValueError unless vertices of a mesh are those of a baked garment, in order: its edges are.

    Returns None; of a garment with every edge halved the ends of its middles, see `ends_of_middles`.
    """
    mesh, file = part.data, baked.file
    count = len(mesh.vertices)
    reason = f"{part.name} was repaired when it was baked, and its vertices are not the mesh's any more"
    node = file.entries("nodes")[garment.node]
    corners = [
        garment.vertices[file.array(primitive["indices"], "SCALAR")[:, 0]].reshape(-1, 3)
        for primitive in file.entries("meshes")[node["mesh"]]["primitives"]
    ]
    sides = np.concatenate([np.roll(faces, turn, 1)[:, :2] for faces in corners for turn in range(3)])
    ends = finer.ends_of_middles(sides, count, garment.size)
    if ends is None and garment.size != count:
        raise ValueError(f"{reason}: merge doubled vertices and delete loose ones first")
    known, asked = sides if ends is None else ends, finer.edges_of(mesh)
    known, asked = (np.sort(each, axis=1) @ [count, 1] for each in (known, asked))
    if not np.isin(asked, known).all():
        raise ValueError(f"{reason}: delete inverted and empty faces first")
    return ends
