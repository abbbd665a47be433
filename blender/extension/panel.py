"""The panel in the sidebar of the 3D view."""

from typing import Any

import bpy

from . import cache, live
from .selection import character_of


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
        layout.operator_menu_enum("uvcloth.dress", "quality", icon="MATCLOTH")
        armature = character_of(context)
        if armature is None:
            layout.label(text="No character with clothes is active")
            return
        settings = armature.uvcloth
        _draw_character(layout.box(), armature)
        column = layout.column(align=True)
        column.prop(settings, "live", toggle=True, icon="PLAY")
        column.operator("uvcloth.cache", icon="FILE_CACHE")
        if cache.is_cached(armature):
            column.operator("uvcloth.drop_cache", icon="X")
        world = layout.column()
        world.use_property_split = True
        world.prop(settings, "wind")
        world.prop(settings, "gravity")
        if fault := live.FAULTS.get(armature.session_uid):
            _draw_sentence(layout.box(), fault, context.region.width)


def _draw_character(layout: Any, armature: Any) -> None:
    """Draw the armature, its garments, and how fine its cloth is."""
    layout.label(text=armature.name, icon="ARMATURE_DATA")
    for entry in armature.uvcloth.garments:
        name = entry.part.name if entry.part else "(gone)"
        layout.label(text=name, icon="MATCLOTH")
    session = live.SESSIONS.get(armature.session_uid)
    if session is not None:
        layout.label(text=f"Cage of {session.outfit.cages:,} vertices")
        layout.label(text=f"{len(session.timeline):,} frames played")


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
