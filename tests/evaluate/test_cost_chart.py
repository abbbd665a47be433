"""Charts against cost: points at their places, names that do not cover each other, and the floors."""

import re
from itertools import pairwise

import pytest

from evaluate.cost_chart import LINE, Axis, CostPoint, ReferenceLine, cost_chart
from evaluate.cost_figures import cost_charts, small_multiples
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
    axis = Axis(1.0, 100.0, 0.0, 200.0)
    assert [axis.at(value) for value in (0.5, 1.0, 10.0, 100.0, 900.0)] == pytest.approx(
        [0, 0, 100, 200, 200]
    )
    assert axis.ticks() == [1, 2, 5, 10, 20, 50, 100]
    assert Axis(0.01, 100.0, 0.0, 1.0).ticks() == pytest.approx([0.01, 0.1, 1, 10, 100])


def point(index: int, error: float, raw: float, ms: float | None, name: str = "") -> CostPoint:
    return CostPoint(name or f"m{index}", index, error, raw, ms, ms, f"{error:.2f} mm")


def test_a_better_method_lies_lower_and_a_quicker_one_further_left() -> None:
    points = [point(0, 10.0, 20.0, 100.0), point(1, 30.0, 40.0, 1.0)]
    floors = [
        ReferenceLine(5.0, "another simulation 5.00 mm"),
        ReferenceLine(1.4, "limit of cages", "floor f0"),
    ]
    chart = cost_chart("dress", points, floors, "mm", True)
    ((slow_x, slow_y),), ((quick_x, quick_y),) = places(chart, "m0"), places(chart, "m1")
    assert quick_x < slow_x
    assert quick_y < slow_y
    lines = [float(y) for y in re.findall(r'<line class="floor[ f0]*"[^>]* y1="([\d.]+)"', chart)]
    assert slow_y < min(lines) < max(lines) == lines[1]
    assert "no time" not in chart
    assert "another simulation" not in cost_chart("dress", points, [], "mm", True)


def test_names_do_not_cover_each_other_and_stay_on_the_chart() -> None:
    points = [point(k, 10.0 + 0.01 * k, 11.0, 5.0) for k in range(22)]
    vellum = point(22, 9.0, 9.0, None, "vellum")
    floors = [ReferenceLine(8.0 + k, f"floor{k} is here") for k in range(3)]
    chart = cost_chart("dress", [*points, vellum], floors, "mm", True)
    heights = names(chart)
    assert len(heights) == 26
    rows = sorted(heights.values())
    assert min(after - before for before, after in pairwise(rows)) >= LINE - 0.11
    tall = re.search(r'viewBox="0 0 560 ([\d.]+)"', chart)
    assert tall
    assert 20.0 < rows[0] < rows[-1] < float(tall[1])


def test_every_garment_has_charts_of_error_and_swing_with_their_floors() -> None:
    results = fake_results()
    for k, by_garment in enumerate(results["simulation"]["actions"].values()):
        by_garment["tops"] |= {"swing_ratio_member": 0.9 + 0.1 * k, "swing_correlation_member": 0.75}
    for method in results["methods"].values():
        method["representation"] = {"tops": {"mm": 1.25, "swing_ratio": 0.96, "swing_correlation": 0.97}}
        for by_garment in method["actions"].values():
            for each in by_garment.values():
                each |= {"swing_ratio": 0.5, "swing_ratio_raw": 0.4, "swing_correlation": 0.625}
    error, swing, dress, _ = cost_charts(results)
    assert names(error).keys() == {*MEANS, "another", "limit"}
    assert "another simulation 5.50 mm" in error
    assert "limit of lbs and 2 more 1.25 mm" in error
    assert "another simulation 9.00 mm" in dress
    assert "limit" not in dress
    assert "net 0.50 (0.62), 25.0 ms" in swing
    assert "another simulation 1.00 (0.75)" in swing
    assert "limit of lbs and 2 more 0.96 (0.97)" in swing
    assert {y for _, y in places(swing, "m0")} == {y for _, y in places(swing, "m2")}
    small = small_multiples(results)
    assert {garment: len(charts) for garment, charts in small.items()} == {"tops": 6, "dress": 6}
    assert "another simulation 0.90 (0.75)" in small["tops"][1]
    # A program without times, without an error: on the chart, in the part without times.
    exact = results["methods"]["net"]
    for by_garment in exact["actions"].values():
        for cell in by_garment.values():
            cell |= {"vertex_mean_mm": 0.0, "vertex_mean_mm_raw": 0.0}
            for key in ("network_ms", "contact_ms", "ms_per_frame"):
                del cell[key]
    assert all("no time" in chart and "net 0 mm" in chart for chart in cost_charts(results)[::2])
