"""The first screen: what it says about the best method, its cost, and chance."""

from typing import Any

import pytest

from evaluate.__main__ import summary
from evaluate.answers import answers, one_person
from tests.evaluate.test_report import CLEARED, MEANS, cell, fake_results


def said(results: dict[str, Any]) -> list[str]:
    return [" ".join(answer.sentences) for answer in answers(results)]


def test_the_closest_method_is_named_for_each_garment() -> None:
    which, cost, chance = said(fake_results())
    # The means of three actions are 3 mm apart; the better LBS is lbs_smooth.
    closest, against = CLEARED * (MEANS["net"] + 3), round(100 * (1 - 27 / 33))
    assert f"net for tops ({closest:.1f} mm, {against} % less than the better LBS), dress (28.8 mm" in which
    assert "Next: lbs_smooth for tops (26.4 mm), dress (33.6 mm)." in which
    assert "33.3 ms for each one" in cost
    assert "The closest method takes: net for tops (25.0 ms), dress (25.0 ms). No faster one" in cost
    assert "Not known: no window was simulated more than once" in chance


def test_a_faster_method_that_is_nearly_as_close_is_named() -> None:
    results = fake_results()
    for by_garment in results["methods"]["lbs"]["actions"].values():
        by_garment["tops"] = {**cell(29.0), "ms_per_frame": 2.0}
    assert "Faster, with at most a tenth more error: lbs for tops (2.00 ms)." in said(results)[1]


def test_swing_and_spread_are_said_where_they_are_measured() -> None:
    results = fake_results()
    for name, swing in (("lbs", 0.2), ("net", 0.9)):
        for by_garment in results["methods"][name]["actions"].values():
            by_garment["tops"]["swing_ratio"] = swing
    for clip in results["methods"]["net"]["clips"]["tops"].values():
        clip |= {"ensemble_mm": 30.0, "spread_mm": 12.0}
    which, _, chance = said(results)
    assert "Nearest to its swing: net for tops (0.90 of it)." in which
    assert (
        "Nearest: net for tops (2.50 times) as far from the simulations as these are from each other"
        in chance
    )
    assert "dress" not in chance


@pytest.mark.parametrize("people", [[], ["02", "12"], ["02"]])
def test_windows_of_one_person_only_are_named(people: list[str]) -> None:
    results = fake_results() | {"people": people}
    sentence = "All windows are of one person (02): no figure says how it is for others."
    assert one_person(results) == (sentence if people == ["02"] else "")
    assert (sentence in said(results)[2]) == (sentence in summary(results)) == (people == ["02"])
