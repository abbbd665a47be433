"""Fabrics: the material of cloth in SI units, for every engine."""

from dataclasses import dataclass

AIR_DENSITY = 1.2
"""Density of air at 20 degrees, kg/m3."""


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
    bend: float = 1.5e-5
    friction: float = 0.4
    drag: float = 1.2
