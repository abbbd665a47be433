"""The character that is meant: the active object, its armature, or the armature of a garment."""

from typing import Any

from . import live


def character_of(context: Any) -> Any:
    """The armature with baked clothes that is active, or whose garment or part is; None if there is none."""
    active = context.active_object
    if active is None:
        return None
    for armature in live.characters():
        parts = [entry.part for entry in armature.uvcloth.garments]
        if active in (armature, *parts) or active.parent == armature:
            return armature
    return None
