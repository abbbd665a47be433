"""Limits to the size of garments."""

from pathlib import Path

from uvcloth.errors import InputError

MOST_VERTICES = 200_000
"""Limit for the vertices of a garment: a rollout could not handle more."""

MOST_FACES = 2_000_000
"""Limit for the faces of a garment, far more than MOST_VERTICES need."""


def refuse_too_many(path: Path, vertices: int, faces: int = 0) -> None:
    """Raise InputError for a mesh of more than MOST_VERTICES or MOST_FACES."""
    if vertices > MOST_VERTICES:
        raise InputError(
            f"{path}: the garment has {vertices:,} vertices, at most {MOST_VERTICES:,} are supported: "
            "reduce the mesh first"
        )
    if faces > MOST_FACES:
        raise InputError(f"{path}: the garment has {faces:,} faces, at most {MOST_FACES:,} are supported")
