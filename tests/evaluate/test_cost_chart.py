"""Error against cost: points at their places, and names that do not cover each other."""

import re
from itertools import pairwise

import pytest

from evaluate.cost_chart import LINE, CostPoint, LogAxis, cost_chart, cost_charts
from tests.evaluate.test_report import MEANS, fake_results


def places(chart: str, shape: str) -> list[tuple[float, float]]:
    """Centres of discs or rings."""
    found = re.findall(rf'<circle class="{shape}" cx="([\d.]+)" cy="([\d.]+)"', chart)
    return [(float(x), float(y)) for x, y in found]


def names(chart: str) -> dict[str, float]:
    """Heights of the names of methods."""
    labels = re.findall(r'<text class="label" x="352" y="([\d.]+)">(\S+) ', chart)
    return {name: float(y) for y, name in labels}


def test_axes_are_logarithmic() -> None:
    axis = LogAxis(1.0, 100.0, 0.0, 200.0)
    assert [axis.at(value) for value in (0.5, 1.0, 10.0, 100.0, 900.0)] == pytest.approx(
        [0, 0, 100, 200, 200]
    )
    assert axis.ticks() == [1, 2, 5, 10, 20, 50, 100]
    assert LogAxis(0.01, 100.0, 0.0, 1.0).ticks() == pytest.approx([0.01, 0.1, 1, 10, 100])


def test_a_better_method_lies_lower_and_a_quicker_one_further_left() -> None:
    points = [CostPoint("slow", 0, 10.0, 20.0, 100.0, 100.0), CostPoint("quick", 1, 30.0, 40.0, 1.0, 0.5)]
    chart = cost_chart("dress", points, 5.0)
    ((slow_x, slow_y),), ((quick_x, quick_y),) = places(chart, "m0"), places(chart, "m1")
    assert quick_x < slow_x
    assert quick_y < slow_y
    assert "another simulation 5.00 mm" in chart
    assert "no time" not in chart
    assert "another simulation" not in cost_chart("dress", points, None)


def test_names_do_not_cover_each_other_and_stay_on_the_chart() -> None:
    points = [CostPoint(f"m{k}", k, 10.0 + 0.01 * k, 11.0, 5.0, 1.0) for k in range(12)]
    heights = names(cost_chart("dress", [*points, CostPoint("vellum", 12, 9.0, 9.0, None, None)], 8.0))
    assert len(heights) == 13
    rows = sorted(heights.values())
    assert min(after - before for before, after in pairwise(rows)) >= LINE - 0.11
    assert 20.0 < rows[0] < rows[-1] < 290.0


def test_every_garment_has_a_chart_of_its_methods_and_its_floor() -> None:
    results = fake_results()
    charts = cost_charts(results)
    assert len(charts) == 2
    assert names(charts[0]).keys() == MEANS.keys()
    assert ["another simulation 5.50 mm" in charts[0], "another simulation 9.00 mm" in charts[1]] == [
        True,
        True,
    ]
    # A program without times, without an error: on the chart, in the part without times.
    exact = results["methods"]["net"]
    for by_garment in exact["actions"].values():
        for cell in by_garment.values():
            cell |= {"vertex_mean_mm": 0.0, "vertex_mean_mm_raw": 0.0}
            for key in ("network_ms", "contact_ms", "ms_per_frame"):
                del cell[key]
    assert all("no time" in chart and "net 0 mm" in chart for chart in cost_charts(results))
