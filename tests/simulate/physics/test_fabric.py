"""What textile laboratories measure, of the fabrics that engines are told."""

from dataclasses import replace
from typing import Any

import pytest

from tests.simulate.physics.experiments import LIMP, bending_length, cantilever, drape, sag
from uvcloth.simulate.fabric import Fabric

JERSEY = replace(LIMP, density=0.15, stretch=60.0)
COTTON = replace(LIMP, density=0.15, stretch=300.0)
DENIM = replace(LIMP, density=0.15, stretch=1500.0)
"""Told apart by how they stretch alone, so that their weight pulls all alike."""


def test_the_default_fabric_drapes_like_cotton(engine: Any) -> None:
    """Cusick's coefficient of cotton is 60 to 76 %."""
    assert 0.60 < drape(engine) < 0.76


@pytest.mark.cannot(
    "newton", "its bending is told ninefold, by the drape on edges of 19 mm; others need another factor"
)
def test_a_strip_overhangs_as_its_rigidity_says(engine: Any) -> None:
    """Peirce's cantilever, ASTM D1388."""
    stiff = replace(engine, fabric=Fabric(bend=1e-4))
    assert cantilever(stiff, edges=4)[0] == pytest.approx(bending_length(stiff.fabric), rel=0.1)


@pytest.mark.cannot(
    "newton", "stopped early, it bears weight the worse the stiffer a membrane is: 1.2 %, 1.7 %"
)
def test_jersey_stretches_most_and_denim_least(engine: Any) -> None:
    jersey, cotton, denim = (sag(replace(engine, fabric=each), 0.3) for each in (JERSEY, COTTON, DENIM))
    assert jersey > cotton > denim
