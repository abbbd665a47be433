"""The list of a character's garments, the innermost first: put on, taken off, moved up and down."""

from typing import Any

import bpy

from . import finer, selection, surface
from .selection import character_of


class PutOn(bpy.types.Operator):
    """Put the selected meshes on the active armature, over what it wears"""

    bl_idname = "uvcloth.put_on"
    bl_label = "Put On"
    bl_options = {"UNDO"}  # noqa: RUF012

    def execute(self, context: Any) -> set[str]:
        """Add them to the list."""
        try:
            armature, _ = selection.wearer_of(context)
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        armature.uvcloth.active = len(armature.uvcloth.garments) - 1
        return {"FINISHED"}


class TakeOff(bpy.types.Operator):
    """Take the garment off the list; the mesh stays in the scene"""

    bl_idname = "uvcloth.take_off"
    bl_label = "Take Off"
    bl_options = {"UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Offer it where there is a garment."""
        return active_entry(character_of(context)) is not None

    def execute(self, context: Any) -> set[str]:
        """Remove the active garment; others that are live stay so."""
        armature = character_of(context)
        settings, entry = armature.uvcloth, active_entry(armature)
        finer.drop(context, entry)
        if entry.part is not None:
            surface.take_off(entry.part)
        settings.garments.remove(settings.active)
        settings.active = max(settings.active - 1, 0)
        if not any(entry.row >= 0 for entry in settings.garments):
            settings.live = False
        return {"FINISHED"}


class MoveGarment(bpy.types.Operator):
    """Wear the garment beneath the one before it, or over the one after it; then dress again"""

    bl_idname = "uvcloth.move_garment"
    bl_label = "Move Garment"
    bl_options = {"UNDO"}  # noqa: RUF012

    outwards: bpy.props.BoolProperty(name="Outwards")

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Offer it where there is a garment."""
        return active_entry(character_of(context)) is not None

    def execute(self, context: Any) -> set[str]:
        """Move it by one place, if there is one."""
        settings = character_of(context).uvcloth
        place = settings.active + (1 if self.outwards else -1)
        if not 0 <= place < len(settings.garments):
            return {"CANCELLED"}
        settings.garments.move(settings.active, place)
        settings.active = place
        return {"FINISHED"}


class GarmentList(bpy.types.UIList):
    """Garments by name and fabric."""

    bl_idname = "VIEW3D_UL_uvcloth_garments"

    def draw_item(
        self,
        _context: Any,
        layout: Any,
        _settings: Any,
        entry: Any,
        _icon: Any,
        _active_settings: Any,
        _active_name: Any,
    ) -> None:
        """Draw one."""
        row = layout.row()
        row.label(text=entry.part.name if entry.part else "(gone)", icon="MATCLOTH")
        row.label(text=entry.bl_rna.properties["fabric"].enum_items[entry.fabric].name)


def active_entry(armature: Any) -> Any:
    """The garment that is active in the list of a character; None if there is none."""
    if armature is None:
        return None
    settings = armature.uvcloth
    return settings.garments[settings.active] if 0 <= settings.active < len(settings.garments) else None


def draw_garments(layout: Any, armature: Any) -> None:
    """Draw the list, and how the active garment is worn."""
    settings = armature.uvcloth
    row = layout.row()
    row.template_list(GarmentList.bl_idname, "", settings, "garments", settings, "active", rows=3)
    column = row.column(align=True)
    column.operator(PutOn.bl_idname, text="", icon="ADD")
    column.operator(TakeOff.bl_idname, text="", icon="REMOVE")
    column.separator()
    column.operator(MoveGarment.bl_idname, text="", icon="TRIA_UP").outwards = False
    column.operator(MoveGarment.bl_idname, text="", icon="TRIA_DOWN").outwards = True
    entry = active_entry(armature)
    if entry is None or entry.part is None:
        return
    worn = layout.column()
    worn.use_property_split = True
    worn.prop(entry, "fabric")
    worn.prop(entry, "hold")
    worn.prop_search(entry, "pins", entry.part, "vertex_groups")
    worn.prop_search(entry, "bone", armature.data, "bones")
    worn.prop(entry, "into")
    if entry.row < 0 and armature.uvcloth.live:
        layout.label(text="Dress to make it live", icon="INFO")
