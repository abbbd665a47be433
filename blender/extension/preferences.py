"""Preferences of the extension: where the laboratory is."""

from typing import Any

import bpy


class Preferences(bpy.types.AddonPreferences):
    """The Python that has uvcloth; baked files need none."""

    bl_idname = __package__

    python: bpy.props.StringProperty(
        name="Python with uvcloth",
        subtype="FILE_PATH",
        description="The interpreter of an environment with `pip install uvcloth`, to dress characters",
    )

    wheels: bpy.props.StringProperty(
        name="Folder of wheels",
        subtype="DIR_PATH",
        description="What Make One takes a Python with uvcloth from; nothing is downloaded",
    )

    def draw(self, _context: Any) -> None:
        """Draw the paths, and what makes a Python."""
        self.layout.prop(self, "python")
        row = self.layout.row(align=True)
        row.prop(self, "wheels")
        row.operator("uvcloth.make_environment", icon="ADD")
        row = self.layout.row()
        row.label(text="Or, in a terminal, from the package index:")
        row.operator("uvcloth.copy_command", icon="COPYDOWN")


def python_of(context: Any) -> str:
    """The laboratory's Python. Raises ValueError if none is named."""
    python = bpy.path.abspath(context.preferences.addons[__package__].preferences.python)
    if not python:
        raise ValueError("name a Python that has uvcloth in the preferences of this extension")
    return str(python)
