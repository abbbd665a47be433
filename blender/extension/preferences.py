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
        description="What a Python with uvcloth is made from; empty for the package index on the internet",
    )

    def draw(self, _context: Any) -> None:
        """Draw the paths."""
        row = self.layout.row(align=True)
        row.prop(self, "python")
        row.operator("uvcloth.make_environment", icon="ADD")
        self.layout.prop(self, "wheels")


def python_of(context: Any) -> str:
    """The laboratory's Python. Raises ValueError if none is named."""
    python = bpy.path.abspath(context.preferences.addons[__package__].preferences.python)
    if not python:
        raise ValueError("name a Python that has uvcloth in the preferences of this extension")
    return str(python)
