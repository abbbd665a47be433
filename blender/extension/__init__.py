# SPDX-License-Identifier: GPL-3.0-or-later
"""Clothes that move with a character while the timeline plays."""

import bpy

from . import (
    cache,
    dressing,
    environment,
    fitting,
    laboratory,
    live,
    opening,
    panel,
    posing,
    preferences,
    properties,
    wardrobe,
)

CLASSES = (
    preferences.Preferences,
    environment.MakeEnvironment,
    environment.CopyCommand,
    opening.OpenBaked,
    wardrobe.PutOn,
    wardrobe.TakeOff,
    wardrobe.MoveGarment,
    wardrobe.GarmentList,
    fitting.Fit,
    fitting.AcceptFit,
    fitting.TakeBackFit,
    fitting.Check,
    dressing.Dress,
    dressing.BakeToFile,
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
    posing.register()


def unregister() -> None:
    """Take all of it away."""
    laboratory.close()
    posing.unregister()
    live.unregister()
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
    properties.unregister()
