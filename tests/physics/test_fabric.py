"""What a network reads of a fabric, and by which names fabrics are asked for."""

import re
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest

from uvcloth.physics.fabric import FABRICS, FEATURES, JERSEY, RANGES, Fabric, FabricName


def test_the_jersey_is_what_others_are_measured_by() -> None:
    assert JERSEY.features() == (0.0,) * FEATURES
    distinct = {FABRICS[name].features() for name in get_args(FabricName)}
    assert len(distinct) == len(FABRICS) == len(get_args(FabricName))


def test_the_manual_says_the_numbers_of_each_fabric() -> None:
    page = (Path(__file__).parents[2] / "docs" / "simulation.md").read_text(encoding="utf-8")
    table = [[cell.strip() for cell in row.split("|")] for row in re.findall(r"^\|(.*)\|$", page, re.M)]
    found = {row[0].split(" ")[0]: row[1:5] for row in table if row[0].split(" ")[0] in FABRICS}
    assert {name: tuple(map(float, cells)) for name, cells in found.items()} == {
        name: (fabric.density, fabric.stretch, fabric.bend, fabric.friction)
        for name, fabric in FABRICS.items()
    }


@pytest.mark.parametrize("name", RANGES)
def test_every_number_of_a_fabric_is_read(name: str) -> None:
    """Also the least and the greatest, as finite numbers."""
    for value in RANGES[name]:
        features = replace(JERSEY, **{name: value}).features()
        assert features != JERSEY.features()
        assert all(abs(feature) < 100 for feature in features)


def test_cloth_that_hangs_alike_differs_by_its_weight_alone() -> None:
    """Twice the weight with twice the stiffnesses drapes the same."""
    twice = Fabric(density=2 * JERSEY.density, stretch=2 * JERSEY.stretch, bend=2 * JERSEY.bend)
    assert twice.features() == pytest.approx((0.6931, 0, 0, 0, 0, 0), abs=1e-4)
