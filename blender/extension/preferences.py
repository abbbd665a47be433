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

    def draw(self, _context: Any) -> None:
        """Draw the path."""
        self.layout.prop(self, "python")


def python_of(context: Any) -> str:
    """The laboratory's Python. Raises ValueError if none is named."""
    python = bpy.path.abspath(context.preferences.addons[__package__].preferences.python)
    if not python:
        raise ValueError("name a Python that has uvcloth in the preferences of this extension")
    return str(python)
