"""Designs: what they hold is checked, and what is drawn is always one that can be written and read."""

import re
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from uvcloth.errors import InputError
from uvcloth.physics.fabric import FABRICS, fabric_from
from uvcloth.wardrobe.designs import Design, limits
from uvcloth.wardrobe.draw import LOWERS, OUTFITS, UPPERS, draw

SHORTS: dict[str, Any] = {"legs": {"drop": 0.02, "length": 0.6, "ease": 0.01, "flare": 0.0}}


def test_a_design_is_read_back_from_its_numbers() -> None:
    design = Design.of("shorts", SHORTS)
    assert design.legs is not None
    assert design.legs.length == 0.6
    assert design.parameters() == SHORTS


@pytest.mark.parametrize(
    ("kind", "parameters", "sentence"),
    [
        ("cape", SHORTS, "design: cape is not a type of piece, expected one of tshirt"),
        ("c" * 9999, SHORTS, f"design: {'c' * 40} is not a type of piece"),
        ("skirt", SHORTS, "design: the parts of skirt have to be skirt"),
        ("shorts", {"legs": {"drop": 0.02}}, "design: legs: expected the numbers drop, length, ease, flare"),
        (
            "shorts",
            {"legs": {**SHORTS["legs"], "length": 9.0}},
            "length is 9.0, expected a number from 0.35 to 2",
        ),
        (
            "shorts",
            {"legs": {**SHORTS["legs"], "ease": "wide"}},
            "ease is wide, expected a number from 0.005",
        ),
        ("shorts", {"legs": {**SHORTS["legs"], "ease": float("nan")}}, "ease is nan, expected a number"),
    ],
)
def test_a_wrong_design_is_refused_in_one_sentence(
    kind: str, parameters: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(InputError, match=re.escape(sentence)):
        Design.of(kind, parameters)


def test_draws_are_of_the_types_asked_for_and_the_inner_piece_comes_first() -> None:
    for number in range(40):
        one = draw(np.random.default_rng(number), ["jacket+skirt"], (1200, 1300))
        assert [design.kind for design in one.designs] == ["skirt", "jacket"]
        assert 1200 <= one.meshing.vertices <= 1300
        assert one.designs[1].upper is not None
        assert one.designs[1].upper.front_gap > 0.01


def test_all_types_are_drawn_and_tighter_outfits_have_less_ease() -> None:
    drawn = [draw(np.random.default_rng(number), OUTFITS, (1000, 2000)) for number in range(400)]
    assert {design.kind for one in drawn for design in one.designs} >= {*UPPERS, *LOWERS, "gown", "jumpsuit"}
    legs = [(one.tightness, design.legs.ease) for one in drawn for design in one.designs if design.legs]
    assert np.corrcoef(np.array(legs).T)[0, 1] < -0.7


def test_drawn_fabrics_are_near_those_of_their_names() -> None:
    drawn = [draw(np.random.default_rng(number), OUTFITS, (1000, 2000)) for number in range(100)]
    assert {one.fabric_name for one in drawn} == set(FABRICS)
    for one in drawn:
        usual = FABRICS[one.fabric_name]
        assert one.fabric.density == pytest.approx(usual.density, rel=0.16)
        assert one.fabric.friction == usual.friction
        assert fabric_from(asdict(one.fabric), "it") == one.fabric
    assert len({one.fabric.bend for one in drawn}) > 90


def test_every_number_has_a_range() -> None:
    for part in (type(Design.of("shorts", SHORTS).legs),):
        assert all(low < high for low, high in limits(part).values())
