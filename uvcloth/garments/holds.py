"""Holds: places that a person names to hold garments up, instead of those that are found."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.garments.places import PLACES, places


@dataclass(frozen=True)
class Hold:
    """A place that holds a garment up; garment: its name, "" for all that have the place."""

    place: str
    garment: str = ""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read PLACE or GARMENT:PLACE. Raises InputError for an unknown place."""
        garment, _, place = text.rpartition(":")
        if place not in PLACES:
            raise InputError(f"--hold {text}: expected PLACE or GARMENT:PLACE, with {', '.join(PLACES)}")
        return cls(place, garment)

    def __str__(self) -> str:
        return f"{self.garment}:{self.place}" if self.garment else self.place


def held_at(garments: Sequence[Garment], holds: Sequence[Hold], body: Body) -> tuple[Garment, ...]:
    """Garments with the places that hold them, in order; one that no hold names is held as before.

    Raises InputError for the name of a garment that is not worn, and for a place that it, or none, has.
    """
    names = [garment.name for garment in garments]
    has = [("top", *places(garment.mesh, body)) for garment in garments] if holds else []
    held: list[tuple[str, ...]] = [() for _ in garments]
    for hold in holds:
        if hold.garment and hold.garment not in names:
            raise InputError(f"--hold {hold}: {hold.garment} is not worn; worn are {', '.join(names)}")
        meant = [index for index, name in enumerate(names) if hold.garment in ("", name)]
        if not any(hold.place in has[index] for index in meant):
            choices = "; ".join(f"{names[index]} has {', '.join(has[index])}" for index in meant)
            raise InputError(f"--hold {hold}: no {hold.place} is found; {choices}")
        for index in meant:
            if hold.place in has[index]:
                held[index] = (*held[index], hold.place)
    return tuple(replace(garment, holds=where) for garment, where in zip(garments, held, strict=True))
