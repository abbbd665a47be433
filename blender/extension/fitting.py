"""Fit and Check: how the laboratory would move garments before it bakes them, shown in the scene."""

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from . import errands, sending
from .copies import copy_beside
from .errands import Errand, LaboratoryOperator, report_to
from .selection import character_of

MARK = "uvcloth check"
"""Vertex group of vertices that start wrong: weight 1 where they stay so, REPAIRED where the bake moves them.
"""

REPAIRED = 0.5

LEAST_MOVED = 0.0005
"""Share of the character's height by which a garment has to be moved for a preview."""

PREVIEW_COLOR = (0.15, 0.6, 1.0, 1.0)
"""Colour of previews where the viewport shows colours of objects."""


class Fit(LaboratoryOperator, bpy.types.Operator):
    """Show how the garments would be moved out of the body and over each other, as previews; Esc stops"""

    bl_idname = "uvcloth.fit"
    bl_label = "Fit"
    bl_options = {"UNDO"}  # noqa: RUF012

    def begin(self, context: Any) -> Errand:
        """Send the garments to be fitted."""
        return errands.begin(context, "rest", "rest.npz")

    def finish(self, context: Any, errand: Errand) -> None:
        """Make a preview of each garment that would be moved."""
        fitted = [
            _local(errand, part, vertices)
            for part, (vertices,) in zip(errand.garments, _arrays(errand, "vertices"), strict=True)
        ]
        take_back(errand.armature)
        entries = {entry.part: entry for entry in errand.armature.uvcloth.garments}
        lines, shown = [], False
        height = errand.armature.dimensions.z or 1.0
        for part, vertices in zip(errand.garments, fitted, strict=True):
            world = np.array(part.matrix_world, np.float64)[:3, :3]
            moved = np.linalg.norm((vertices - sending.vertices_of(part.data)) @ world.T, axis=1)
            if moved.max() < LEAST_MOVED * height:
                lines.append(f"{part.name} lies well")
                continue
            shown = True
            entries[part].preview = _preview(part, vertices)
            entries[part].display = part.display_type
            part.display_type = "WIRE"
            lines.append(
                f"{part.name} would be moved by up to {_length(context, moved.max())}, "
                f"{_length(context, moved.mean())} on average"
            )
        report_to(self, lines, warns=False)
        if not shown:
            take_back(errand.armature)


class AcceptFit(bpy.types.Operator):
    """Move the garments to their previews; shape keys are moved along. Dress again for live cloth"""

    bl_idname = "uvcloth.accept_fit"
    bl_label = "Accept"
    bl_options = {"UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Offer it while there are previews."""
        return has_previews(character_of(context))

    def execute(self, context: Any) -> set[str]:
        """Move all of them, or none."""
        armature = character_of(context)
        pairs = [(entry.part, entry.preview) for entry in armature.uvcloth.garments if entry.preview]
        for part, preview in pairs:
            if part is None or len(part.data.vertices) != len(preview.data.vertices):
                self.report({"ERROR"}, f"{preview.name} is of another mesh: take it back, and fit again")
                return {"CANCELLED"}
        for part, preview in pairs:
            _move_mesh(part.data, sending.vertices_of(preview.data))
        take_back(armature)
        return {"FINISHED"}


class TakeBackFit(bpy.types.Operator):
    """Remove the previews; the garments stay as they are"""

    bl_idname = "uvcloth.take_back_fit"
    bl_label = "Take Back"
    bl_options = {"UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Offer it while there are previews."""
        return has_previews(character_of(context))

    def execute(self, context: Any) -> set[str]:
        """Remove them."""
        take_back(character_of(context))
        return {"FINISHED"}


class Check(LaboratoryOperator, bpy.types.Operator):
    """Mark vertices of the garments that start in the body or beneath another garment; Esc stops"""

    bl_idname = "uvcloth.check"
    bl_label = "Check"
    bl_options = {"UNDO"}  # noqa: RUF012

    def begin(self, context: Any) -> Errand:
        """Send the garments to be looked at."""
        return errands.begin(context, "rest", "rest.npz")

    def finish(self, context: Any, errand: Errand) -> None:
        """Mark vertices, and say how many there are."""
        masks = _arrays(errand, "inside", "beneath", "left")
        lines, warns = [], False
        for part, (inside, beneath, left) in zip(errand.garments, masks, strict=True):
            _mark(part, inside | beneath, left)
            starts = [
                f"{np.count_nonzero(mask):,} vertices start {where}"
                for mask, where in ((inside, "in the body"), (beneath, "beneath what it is worn over"))
                if mask.any()
            ]
            if starts or left.any():
                warns = warns or bool(left.any())
                end = f"{np.count_nonzero(left):,} stay so" if left.any() else "the bake moves them out"
                lines.append(f"{part.name}: {', '.join([*starts, end])} (vertex group {MARK})")
        report_to(self, lines or ["no garment starts in the body or beneath another one"], warns)


def has_previews(armature: Any) -> bool:
    """Tell whether a character has previews of garments."""
    return armature is not None and any(entry.preview for entry in armature.uvcloth.garments)


def take_back(armature: Any) -> None:
    """Remove the previews of a character's garments."""
    for entry in armature.uvcloth.garments:
        preview = entry.preview
        if preview is None:
            continue
        entry.preview = None
        bpy.data.meshes.remove(preview.data)  # Its object goes with it.
        if entry.part is not None:
            entry.part.display_type = entry.display


def _arrays(errand: Errand, *kinds: str) -> list[list[NDArray[Any]]]:
    """Arrays of some kinds of each garment, with a row for each vertex of its mesh.

    Raises ValueError for a mesh whose vertices are others in the laboratory.
    """
    with np.load(errand.result) as stored:
        arrays = [[stored[f"{name}.{kind}"] for kind in kinds] for name in errand.names]
    for part, (first, *_) in zip(errand.garments, arrays, strict=True):
        if len(first) != len(part.data.vertices):
            raise ValueError(f"{part.name} was repaired: merge doubled vertices and delete loose ones first")
    return arrays


def _local(errand: Errand, part: Any, vertices: NDArray[np.floating]) -> NDArray[np.float64]:
    """Vertices (V, 3) of the character's file in the axes of a garment's mesh."""
    back = np.linalg.inv(sending.to_file(part, errand.armature))
    return vertices @ back[:3, :3].T + back[:3, 3]


def _preview(part: Any, vertices: NDArray[np.float64]) -> Any:
    """A new object that shows a garment with other vertices, below the same modifiers."""
    preview = copy_beside(part, f"{part.name} fit")
    preview.data.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    preview.data.update()
    preview.color = PREVIEW_COLOR
    return preview


def _move_mesh(mesh: Any, vertices: NDArray[np.float64]) -> None:
    """Move the vertices (V, 3) of a mesh; its shape keys move as much."""
    moved = vertices - sending.vertices_of(mesh)
    for key in mesh.shape_keys.key_blocks if mesh.shape_keys else ():
        points = np.empty(3 * len(key.data), np.float32)
        key.data.foreach_get("co", points)
        key.data.foreach_set("co", (points.reshape(-1, 3) + moved).astype(np.float32).ravel())
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.update()


def _mark(part: Any, starts: NDArray[np.bool_], left: NDArray[np.bool_]) -> None:
    """Put vertices that start wrong into a vertex group, and select them; without any, there is no group."""
    if (old := part.vertex_groups.get(MARK)) is not None:
        part.vertex_groups.remove(old)
    if (starts | left).any():
        group = part.vertex_groups.new(name=MARK)
        group.add(np.flatnonzero(starts & ~left).tolist(), REPAIRED, "REPLACE")
        group.add(np.flatnonzero(left).tolist(), 1.0, "REPLACE")
    for elements in (part.data.polygons, part.data.edges):
        elements.foreach_set("select", np.zeros(len(elements), bool))
    part.data.vertices.foreach_set("select", left if left.any() else starts)
    part.data.update()


def _length(context: Any, units: float) -> str:
    """A length of the scene as Blender shows it."""
    settings = context.scene.unit_settings
    return bpy.utils.units.to_string(
        settings.system, "LENGTH", float(units) * settings.scale_length, precision=3, compatible_unit=False
    )
