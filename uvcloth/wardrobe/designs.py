"""Designs of garments: their parts, lengths and widths. Lengths are relative to the body that wears them.

A design is an upper part, a lower part or both: a shirt is an upper part alone, trousers are legs alone, a
gown is an upper part and a skirt, a jumpsuit an upper part and legs.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from uvcloth.errors import InputError

RANGE = "range"
"""Key of a field's least and largest value in its metadata."""


def ranged(low: float, high: float) -> Any:
    """Field of a design that is a number between two others."""
    return field(metadata={RANGE: (low, high)})


@dataclass(frozen=True)
class Upper:
    """Cut of what covers the trunk above the waist.

    sleeve: length, 0 none, 1 to the elbow, 2 to the wrist. hem: height between hips, 0, and neck, 1; counts
    only without a lower part. neck_depth: m that the neckline is lower in front than a crew neck's.
    neck_width: m, half the width of what it takes out. neck_power: its shape, 1 a V, 2 round, larger squarer.
    ease, sleeve_ease: m off the skin at the hem and at the cuffs. flare: m more at the hem. front_gap: m
    between the edges of an open front, 0 closed.
    """

    sleeve: float = ranged(0.0, 2.04)
    hem: float = ranged(-0.02, 0.4)
    neck_depth: float = ranged(0.0, 0.13)
    neck_width: float = ranged(0.05, 0.1)
    neck_power: float = ranged(1.0, 3.0)
    ease: float = ranged(0.006, 0.045)
    sleeve_ease: float = ranged(0.006, 0.035)
    flare: float = ranged(0.0, 0.04)
    front_gap: float = ranged(0.0, 0.08)


@dataclass(frozen=True)
class Legs:
    """Cut of trousers or shorts.

    drop: m of the waistband below the waist. length: 1 to the knees, 2 to the ankles. ease: m off the skin.
    flare: m more at the hems.
    """

    drop: float = ranged(0.0, 0.09)
    length: float = ranged(0.35, 2.0)
    ease: float = ranged(0.005, 0.035)
    flare: float = ranged(0.0, 0.06)


@dataclass(frozen=True)
class Skirt:
    """Cut of a skirt.

    drop: m of the waistband below the waist. length: 1 to the knees, 2 to the ankles. ease: m off the outline
    of hips and legs. flare: m that the radius grows per metre downwards, at least. slit: width of the opening
    over its height, 0 none. slit_height: height of the slit over that of the skirt. slit_side: radians around
    the body, 0 at its left side, -pi / 2 in front.
    """

    drop: float = ranged(-0.06, 0.09)
    length: float = ranged(0.3, 1.9)
    ease: float = ranged(0.004, 0.035)
    flare: float = ranged(-0.05, 0.6)
    slit: float = ranged(0.0, 0.15)
    slit_height: float = ranged(0.2, 0.7)
    slit_side: float = ranged(-3.1416, 3.1416)


Part = Upper | Legs | Skirt
PARTS: Mapping[str, type[Part]] = {"upper": Upper, "legs": Legs, "skirt": Skirt}

KINDS: Mapping[str, tuple[str, ...]] = {
    "tshirt": ("upper",),
    "top": ("upper",),
    "longsleeve": ("upper",),
    "jacket": ("upper",),
    "trousers": ("legs",),
    "shorts": ("legs",),
    "skirt": ("skirt",),
    "gown": ("upper", "skirt"),
    "jumpsuit": ("upper", "legs"),
}
"""Types of pieces, and the parts that each has."""


@dataclass(frozen=True)
class Design:
    """Design of one piece. kind: of KINDS, which says the parts that it has."""

    kind: str
    upper: Upper | None = None
    legs: Legs | None = None
    skirt: Skirt | None = None

    @classmethod
    def of(cls, kind: str, parameters: Mapping[str, Mapping[str, float]], source: str = "design") -> "Design":
        """Design from plain numbers, as `parameters` gives them.

        source: beginning of the message of an InputError, which is raised for an unknown kind, for a part or
        number that is missing or unknown, and for a number outside its range.
        """
        if kind not in KINDS:
            raise InputError(
                f"{source}: {kind!s:.40} is not a type of piece, expected one of {', '.join(KINDS)}"
            )
        if not isinstance(parameters, Mapping) or set(parameters) != set(KINDS[kind]):
            raise InputError(f"{source}: the parts of {kind} have to be {' and '.join(KINDS[kind])}")
        parts = {name: _part(PARTS[name], values, f"{source}: {name}") for name, values in parameters.items()}
        return cls(kind, **parts)

    def parameters(self) -> dict[str, dict[str, float]]:
        """The numbers of each part."""
        return {name: asdict(getattr(self, name)) for name in KINDS[self.kind]}


def limits(part: type[Part]) -> dict[str, tuple[float, float]]:
    """Least and largest value of every number of a part."""
    return {each.name: each.metadata[RANGE] for each in fields(part)}


def _part(part: type[Part], values: Mapping[str, float], source: str) -> Any:
    ranges = limits(part)
    if not isinstance(values, Mapping) or set(values) != set(ranges):
        raise InputError(f"{source}: expected the numbers {', '.join(ranges)}")
    for name, (low, high) in ranges.items():
        value = values[name]
        if not isinstance(value, int | float) or not low <= value <= high:
            raise InputError(f"{source}: {name} is {value}, expected a number from {low:g} to {high:g}")
    return part(**{name: float(values[name]) for name in ranges})
