"""What an armature keeps in the .blend of the clothes that move with it."""

from typing import Any

import bpy

from . import live


class GarmentEntry(bpy.types.PropertyGroup):
    """A garment of a character."""

    part: bpy.props.PointerProperty(type=bpy.types.Object, name="Garment")


class BoneEntry(bpy.types.PropertyGroup):
    """A bone that takes the place of a joint."""

    bone: bpy.props.StringProperty()
    to_node: bpy.props.FloatVectorProperty(size=16)


def _change_live(settings: Any, context: Any) -> None:
    live.change(settings.id_data, context)


def _change_world(settings: Any, context: Any) -> None:
    live.refresh(context.scene, context.evaluated_depsgraph_get())


class Character(bpy.types.PropertyGroup):
    """Clothes of an armature, baked."""

    file: bpy.props.StringProperty(
        name="Baked file", description="The .glb that uvcloth bake wrote; // is the folder of the .blend"
    )
    garments: bpy.props.CollectionProperty(type=GarmentEntry)
    bones: bpy.props.CollectionProperty(type=BoneEntry)
    size: bpy.props.FloatProperty(default=1.0)
    live: bpy.props.BoolProperty(
        name="Live", description="Cloth moves with the timeline", update=_change_live
    )
    wind: bpy.props.FloatVectorProperty(
        name="Wind", size=3, min=-50.0, max=50.0, description="m/s; blows through the body"
    )
    gravity: bpy.props.FloatProperty(
        name="Gravity", default=1.0, min=0.0, max=5.0, description="Times the gravity of the scene"
    )


CLASSES = (GarmentEntry, BoneEntry, Character)


def register() -> None:
    """Give every object a place for a character."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Object.uvcloth = bpy.props.PointerProperty(type=Character)


def unregister() -> None:
    """Take it away."""
    del bpy.types.Object.uvcloth
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
