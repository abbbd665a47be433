"""Holds: places, or vertices, that a person names to hold garments up, instead of the place that is found."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.garments.numbered import numbered
from uvcloth.garments.places import PLACES, places

NUMBERS = ".txt"
"""Suffix of a file of vertex numbers."""


@dataclass(frozen=True)
class Hold:
    """A support of a garment: one of PLACES, or a text file of its vertices' numbers, from 0.

    garment: its name, "" for all that have the place.
    """

    place: str
    garment: str = ""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read PLACE, GARMENT:PLACE or GARMENT:FILE. Raises InputError for an unknown place."""
        garment, _, place = text.rpartition(":")
        if text.endswith(NUMBERS):
            # A path on Windows may have a colon itself.
            garment, _, place = text.partition(":")
        if not (place in PLACES or (garment and place.endswith(NUMBERS))):
            raise InputError(
                f"--hold {text}: expected PLACE, GARMENT:PLACE or GARMENT:FILE{NUMBERS}, with "
                f"{', '.join(PLACES)}"
            )
        return cls(place, garment)

    @property
    def is_file(self) -> bool:
        """Test for vertices that a file names."""
        return self.place.endswith(NUMBERS)

    def __str__(self) -> str:
        return f"{self.garment}:{self.place}" if self.garment else self.place


def held_at(garments: Sequence[Garment], holds: Sequence[Hold], body: Body) -> tuple[Garment, ...]:
    """Garments with the places that hold them, in order; one that no hold names is held as before.

    Raises InputError for the name of a garment that is not worn, for a place that it, or none, has, and for a
    file without a vertex.
    """
    names = [garment.name for garment in garments]
    has = [("top", *places(garment.mesh, body)) for garment in garments] if holds else []
    held: list[tuple[str, ...]] = [() for _ in garments]
    pins: list[Tensor | None] = [None for _ in garments]
    for hold in holds:
        if hold.garment and hold.garment not in names:
            raise InputError(f"--hold {hold}: {hold.garment} is not worn; worn are {', '.join(names)}")
        meant = [index for index, name in enumerate(names) if hold.garment in ("", name)]
        if hold.is_file:
            place = names.index(hold.garment)
            pins[place] = _pinned(garments[place], hold, pins[place])
            continue
        if not any(hold.place in has[index] for index in meant):
            choices = "; ".join(f"{names[index]} has {', '.join(has[index])}" for index in meant)
            raise InputError(f"--hold {hold}: no {hold.place} is found; {choices}")
        for index in meant:
            if hold.place in has[index]:
                held[index] = (*held[index], hold.place)
    return tuple(
        replace(garment, holds=where, pins=by)
        for garment, where, by in zip(garments, held, pins, strict=True)
    )


def _pinned(garment: Garment, hold: Hold, others: Tensor | None) -> Tensor:
    """The vertices (N,) bool of a garment that a file names, and others."""
    pins = numbered(Path(hold.place), len(garment.mesh.vertices), garment.name)
    if not pins.any():
        raise InputError(f"--hold {hold}: names no vertex of {garment.name}")
    return pins if others is None else pins | others
