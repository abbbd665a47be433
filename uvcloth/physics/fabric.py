"""Fabrics: the material of cloth in SI units, for every engine."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from uvcloth.errors import InputError

AIR_DENSITY = 1.2
"""Density of air at 20 degrees, kg/m3."""

RANGES = {
    "density": (0.01, 2.0),
    "stretch": (1.0, 1e4),
    "poisson": (0.0, 0.49),
    "bend": (0.0, 1e-2),
    "friction": (0.0, 2.0),
    "drag": (0.0, 100.0),
}
"""Least and greatest value of each number of a fabric."""


@dataclass(frozen=True)
class Fabric:
    """Material of cloth; the default is a cotton jersey: it bends as cotton does and stretches as a knit.

    density: kg/m2. stretch: N/m, membrane stiffness (Young's modulus times thickness). poisson: its Poisson
    ratio. bend: N m, bending rigidity (force times distance per width; Peirce's bending length is the cube
    root of it over the weight per area). friction: coefficient of cloth on the body and on cloth. drag: drag
    coefficient of a face that moves along its normal.
    """

    density: float = 0.2
    stretch: float = 40.0
    poisson: float = 0.2
    bend: float = 3e-5
    friction: float = 0.4
    drag: float = 1.2

    def features(self) -> tuple[float, ...]:
        """FEATURES numbers that a network reads, all 0 for the jersey.

        Logarithms of the weight, of the stiffness per weight and, shifted, of Peirce's bending length, each
        over the jersey's: the last two decide how cloth drapes. Then the differences of the other numbers.
        """
        bending_length = (self.bend / self.density / (JERSEY.bend / JERSEY.density)) ** (1 / 3)
        return (
            math.log(self.density / JERSEY.density),
            math.log(self.stretch / self.density / (JERSEY.stretch / JERSEY.density)),
            math.log((1 + bending_length) / 2),
            self.poisson - JERSEY.poisson,
            self.friction - JERSEY.friction,
            self.drag - JERSEY.drag,
        )


JERSEY = Fabric()
FEATURES = len(JERSEY.features())

FabricName = Literal["jersey", "cotton", "silk", "denim"]

FABRICS: dict[str, Fabric] = {
    "jersey": JERSEY,
    "cotton": Fabric(density=0.15, stretch=60.0, bend=2.0e-5),
    "silk": Fabric(density=0.08, stretch=50.0, bend=2.0e-6, friction=0.25),
    "denim": Fabric(density=0.35, stretch=80.0, bend=8.0e-5, friction=0.5),
}
"""Fabrics by name."""


def find_fabric(fabric: str | Fabric | None) -> Fabric:
    """A fabric, the one of a name, or the jersey for None. Raises InputError for an unknown name."""
    if isinstance(fabric, Fabric):
        return fabric
    if fabric is not None and fabric not in FABRICS:
        raise InputError(f"--fabric {fabric}: expected one of {', '.join(FABRICS)}")
    return JERSEY if fabric is None else FABRICS[fabric]


def find_fabrics(fabric: "FabricChoice", count: int) -> list[Fabric]:
    """The fabric of each of `count` garments: of one for all, of one for each, or the jersey for None.

    Raises InputError as `find_fabric` does, and for another number of fabrics.
    """
    if fabric is None or isinstance(fabric, str | Fabric):
        return [find_fabric(fabric)] * count
    if not fabric:
        return [JERSEY] * count
    if len(fabric) not in (1, count):
        raise InputError(f"--fabric: {len(fabric)} for {count} garments, expected one, or one for each")
    made_of = [find_fabric(each) for each in fabric]
    return made_of if len(made_of) == count else made_of * count


FabricChoice = str | Fabric | Sequence[str | Fabric] | None
"""One fabric for all garments, or one for each; None for the jersey."""


def fabric_from(numbers: Mapping[str, float], where: str) -> Fabric:
    """Make a fabric from its numbers; missing ones are the jersey's.

    where: origin of the numbers, for the error message. Raises InputError for a number that no fabric has,
    and for one out of its range.
    """
    if unknown := numbers.keys() - RANGES.keys():
        raise InputError(
            f"{where}: {min(unknown)!r:.40} is not a property of a fabric; these are {', '.join(RANGES)}"
        )
    for name, value in numbers.items():
        least, most = RANGES[name]
        if not least <= value <= most:
            raise InputError(f"{where}: the fabric's {name} is {value}, expected {least:g} to {most:g}")
    return Fabric(**{name: float(value) for name, value in numbers.items()})
