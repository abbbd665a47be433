"""Tucks: garments whose hem is tucked into another one, and the order of wearing that follows."""

from collections.abc import Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from typing import Self

from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment


@dataclass(frozen=True)
class Tuck:
    """A garment that is tucked into another one, by their names: it is worn beneath, whatever the order."""

    garment: str
    into: str

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read GARMENT:INTO. Raises InputError for another form."""
        garment, colon, into = text.partition(":")
        if not (garment and colon and into):
            raise InputError(f"--tuck {text}: expected GARMENT:INTO, as in shirt:bottoms")
        return cls(garment, into)

    def __str__(self) -> str:
        return f"{self.garment}:{self.into}"


def worn_order(garments: Sequence[Garment], tucks: Sequence[Tuck]) -> tuple[Garment, ...]:
    """Order garments by their tucks, the innermost first; all others keep the order that they are named in.

    What a tucked garment is worn over is inside as well. Raises InputError for the name of a garment that is
    not worn, or worn twice, and for tucks that contradict each other.
    """
    names = [garment.name for garment in garments]
    beneath: dict[str, set[str]] = {name: set() for name in names}
    for tuck in tucks:
        for name in (tuck.garment, tuck.into):
            if names.count(name) != 1:
                fault = "is worn twice" if name in names else "is not worn"
                raise InputError(f"--tuck {tuck}: {name} {fault}; worn are {', '.join(names)}")
        beneath[tuck.into].add(tuck.garment)
    try:
        TopologicalSorter(beneath).prepare()
    except CycleError as error:
        around = " into ".join(error.args[1])
        raise InputError(f"--tuck: the tucks contradict each other, {around}") from error
    waiting, ordered = list(garments), []
    while waiting:
        left = {garment.name for garment in waiting}
        following = next(garment for garment in waiting if not beneath[garment.name] & left)
        waiting.remove(following)
        ordered.append(following)
    return tuple(ordered)
