"""The character that is meant: the active object, its armature, or the armature of a garment."""

from typing import Any

from . import live


def character_of(context: Any) -> Any:
    """The armature with garments that is active, or whose garment or part is; None if there is none."""
    active = context.active_object
    if active is None:
        return None
    for armature in live.characters():
        if active in (armature, *objects_of(armature)) or active.parent == armature:
            return armature
    return None


def wearer_of(context: Any) -> tuple[Any, list[Any]]:
    """The armature that is meant and the entries of its garments, in order; selected meshes are put on.

    Raises ValueError in a sentence.
    """
    armature = context.view_layer.objects.active
    if armature is None or armature.type != "ARMATURE":
        armature = character_of(context)
    if armature is None:
        raise ValueError("select garment meshes, then the armature, which has to be the active object")
    put_on(armature, sorted(context.selected_objects, key=lambda part: part.name))
    entries = [entry for entry in armature.uvcloth.garments if entry.part is not None]
    if not entries:
        raise ValueError(f"select the garment meshes too, beside {armature.name}")
    if not armature.visible_get():
        raise ValueError(f"{armature.name} is hidden: show it")
    for entry in entries:
        if entry.part.name not in context.view_layer.objects:
            raise ValueError(f"{entry.part.name}, a garment of {armature.name}, is not in this view layer")
        if entry.part.data.users > 1:
            raise ValueError(f"the mesh of {entry.part.name} is used by others too: make it single-user")
    return armature, entries


def objects_of(armature: Any) -> list[Any]:
    """The garments of a character, and what shows them: previews, and finer copies."""
    entries = armature.uvcloth.garments
    kinds = [each for entry in entries for each in (entry.part, entry.preview, entry.finer)]
    return [each for each in kinds if each is not None]


def put_on(armature: Any, parts: list[Any]) -> None:
    """Put meshes that are no garments of an armature yet, and no skin of it alone, over the others."""
    worn = objects_of(armature)
    for part in parts:
        if part.type == "MESH" and part not in worn:
            armature.uvcloth.garments.add().part = part
