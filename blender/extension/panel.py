"""The panel in the sidebar of the 3D view."""

from typing import Any

import bpy

from . import cache, fitting, live
from .selection import character_of
from .wardrobe import draw_garments


class ClothPanel(bpy.types.Panel):
    """Clothes of the active character."""

    bl_idname = "VIEW3D_PT_uvcloth"
    bl_label = "Clothes"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "uvcloth"

    def draw(self, context: Any) -> None:
        """Draw buttons, then what the active character has."""
        layout = self.layout
        layout.operator("uvcloth.open_baked", icon="IMPORT")
        armature = character_of(context)
        if armature is not None:
            box = layout.box()
            box.label(text=armature.name, icon="ARMATURE_DATA")
            draw_garments(box, armature)
        column = layout.column(align=True)
        if fitting.has_previews(armature):
            row = column.row(align=True)
            row.operator("uvcloth.accept_fit", icon="CHECKMARK")
            row.operator("uvcloth.take_back_fit", icon="LOOP_BACK")
        else:
            row = column.row(align=True)
            row.operator("uvcloth.fit", icon="MOD_SHRINKWRAP")
            row.operator("uvcloth.check", icon="VIEWZOOM")
        column.operator_menu_enum("uvcloth.dress", "quality", icon="MATCLOTH")
        column.operator_menu_enum("uvcloth.bake_to_file", "quality", icon="EXPORT")
        if armature is None:
            layout.label(text="No character with clothes is active")
        elif armature.uvcloth.file:
            _draw_live(layout, context, armature)


def _draw_live(layout: Any, context: Any, armature: Any) -> None:
    """Draw what baked clothes have: whether they are live, caches, and the world around them."""
    settings = armature.uvcloth
    column = layout.column(align=True)
    column.prop(settings, "live", toggle=True, icon="PLAY")
    column.prop(settings, "posing", toggle=True, icon="POSE_HLT")
    column.operator("uvcloth.cache", icon="FILE_CACHE")
    if cache.is_cached(armature):
        column.operator("uvcloth.drop_cache", icon="X")
    world = layout.column()
    world.use_property_split = True
    world.prop(settings, "wind")
    world.prop(settings, "gravity")
    session = live.SESSIONS.get(armature.session_uid)
    if session is not None:
        frames = f"{len(session.timeline):,} frames played"
        layout.label(text=f"Cage of {session.outfit.cages:,} vertices, {frames}")
    if fault := live.FAULTS.get(armature.session_uid):
        _draw_sentence(layout.box(), fault, context.region.width)


def _draw_sentence(layout: Any, sentence: str, width: int) -> None:
    """Draw a sentence, broken to lines of the region's width, pixels."""
    line, limit = "", max(width // 8, 20)
    lines = []
    for word in sentence.split():
        if line and len(line) + len(word) >= limit:
            lines.append(line)
            line = ""
        line = f"{line} {word}".strip()
    for index, text in enumerate([*lines, line]):
        layout.label(text=text, icon="BLANK1" if index else "ERROR")
