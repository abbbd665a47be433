"""What an armature keeps in the .blend of the clothes that move with it."""

from typing import Any

import bpy

from . import live

FABRICS = (
    ("jersey", "Jersey", "A cotton knit: T-shirts"),
    ("cotton", "Cotton", "A plain weave: shirts"),
    ("silk", "Silk", "Light, soft and smooth"),
    ("denim", "Denim", "Heavy and stiff: trousers"),
)
"""Fabrics of the laboratory."""

HOLDS = (
    ("FOUND", "Found", "The uppermost hem, or the shoulders"),
    ("TOP", "Top", "The uppermost hem of each piece"),
    ("COLLAR", "Collar", "The hem around the neck"),
    ("WAIST", "Waist", "The hem around the waist"),
    ("CUFFS", "Cuffs", "The hems around arms or legs"),
    ("SHOULDERS", "Shoulders", "The cloth on the shoulders"),
)
"""Places that hold garments up."""


def _is_other_garment(entry: Any, part: Any) -> bool:
    others = [other.part for other in entry.id_data.uvcloth.garments]
    return part in others and part != entry.part


class GarmentEntry(bpy.types.PropertyGroup):
    """A garment of a character, and how it is worn.

    row: its place in the baked file, -1 for none. preview: the object that shows where a fit would move it.
    display: how the garment was shown before there was one. finer: the copy that shows it with wrinkles.
    """

    part: bpy.props.PointerProperty(type=bpy.types.Object, name="Garment")
    row: bpy.props.IntProperty(default=-1)
    fabric: bpy.props.EnumProperty(name="Fabric", items=FABRICS, default="jersey")
    hold: bpy.props.EnumProperty(
        name="Held by", items=HOLDS, default="FOUND", description="What holds the garment up"
    )
    pins: bpy.props.StringProperty(
        name="Pins",
        description="Vertex group of vertices that stay on the body, beside what holds it or alone",
    )
    bone: bpy.props.StringProperty(
        name="Pin Bone",
        description="Bone: vertices whose closest skin follows it most stay on the body, as those of Pins",
    )
    into: bpy.props.PointerProperty(
        name="Tucked into",
        type=bpy.types.Object,
        poll=_is_other_garment,
        description="Garment that this one is worn beneath, whatever the order",
    )
    preview: bpy.props.PointerProperty(type=bpy.types.Object)
    display: bpy.props.StringProperty()
    finer: bpy.props.PointerProperty(type=bpy.types.Object)


class BoneEntry(bpy.types.PropertyGroup):
    """A bone that takes the place of a joint."""

    bone: bpy.props.StringProperty()
    to_node: bpy.props.FloatVectorProperty(size=16)


def _change_live(settings: Any, context: Any) -> None:
    live.change(settings.id_data, context)


def _change_world(settings: Any, context: Any) -> None:
    live.refresh(context.scene, context.evaluated_depsgraph_get())


class Character(bpy.types.PropertyGroup):
    """Clothes of an armature, the innermost first, and what was baked of them."""

    file: bpy.props.StringProperty(
        name="Baked file", description="The .glb that uvcloth bake wrote; // is the folder of the .blend"
    )
    garments: bpy.props.CollectionProperty(type=GarmentEntry)
    active: bpy.props.IntProperty(name="Garment")
    bones: bpy.props.CollectionProperty(type=BoneEntry)
    size: bpy.props.FloatProperty(default=1.0)
    live: bpy.props.BoolProperty(
        name="Live", description="Cloth moves with the timeline", update=_change_live
    )
    posing: bpy.props.BoolProperty(
        name="While Posing",
        description="Cloth also follows while the timeline stands and the armature is posed by hand",
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
