# SPDX-License-Identifier: GPL-3.0-or-later
"""Clothes that move with a character while the timeline plays."""

import bpy

from . import cache, dressing, live, opening, panel, preferences, properties

CLASSES = (
    preferences.Preferences,
    opening.OpenBaked,
    dressing.Dress,
    cache.WriteCache,
    cache.DropCache,
    panel.ClothPanel,
)


def register() -> None:
    """Add the panel, its operators, and what listens to the timeline."""
    properties.register()
    for each in CLASSES:
        bpy.utils.register_class(each)
    live.register()


def unregister() -> None:
    """Take all of it away."""
    live.unregister()
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
    properties.unregister()
