"""Copies of an artist's object that lie beside it, below the same modifiers."""

from typing import Any

from . import surface


def copy_beside(part: Any, name: str) -> Any:
    """A copy of a garment's object and mesh in its collections, without cloth, cache and shape keys."""
    copy = part.copy()
    copy.data = part.data.copy()
    copy.name = copy.data.name = name
    if copy.data.shape_keys:
        copy.shape_key_clear()
    for modifier in (surface.MODIFIER, surface.CACHE):
        if modifier in copy.modifiers:
            copy.modifiers.remove(copy.modifiers[modifier])
    for collection in part.users_collection:
        collection.objects.link(copy)
    copy.select_set(False)
    return copy
