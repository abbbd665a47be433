"""Intervals over clips: paired by clip, and a difference within one is not called a difference."""

from typing import Any

import pytest

from evaluate.intervals import LEAST_CLIPS, difference, interval_of, pooled
from evaluate.report import write_report
from evaluate.standings import standings
from tests.evaluate.test_report import fake_results

HARD = (5.0, 12.0, 30.0, 8.0, 21.0, 14.0)


def clips(means: tuple[float, ...], spread: float = 4.0) -> dict[str, dict[str, float | None]]:
    """Clips of 100 frames, and one of 300, with a mean distance that is also that from the ensemble."""
    return {
        f"clip{k}": {
            "frames": 300 if k == 0 else 100,
            "vertex_mean_mm": mean,
            "ensemble_mm": mean,
            "spread_mm": spread,
        }
        for k, mean in enumerate(means)
    }


def test_an_interval_contains_the_figure_and_needs_several_clips() -> None:
    hard = clips(HARD)
    mean = pooled(hard, "vertex_mean_mm", "")
    assert mean == pytest.approx((3 * 5 + sum(HARD[1:])) / 8)
    assert pooled(hard, "spread_ratio", "") == pytest.approx(mean / 4)
    interval = interval_of(hard, "vertex_mean_mm", "")
    assert interval is not None
    assert min(HARD) < interval[0] < mean < interval[1] < max(HARD)
    assert interval_of(clips((7.0,) * 6), "vertex_mean_mm", "") == pytest.approx((7.0, 7.0))
    assert interval_of(clips(HARD[: LEAST_CLIPS - 1]), "vertex_mean_mm", "") is None
    without = {clip: each | {"ensemble_mm": None} for clip, each in hard.items()}
    assert pooled(without, "spread_ratio", "") is interval_of(without, "spread_ratio", "") is None


def test_what_makes_a_clip_hard_for_both_is_no_part_of_a_difference() -> None:
    """Intervals of both overlap by far, and yet one is worse on every clip."""
    better, worse = clips(HARD), clips(tuple(mean + 1.0 for mean in HARD))
    one, other = (interval_of(each, "vertex_mean_mm", "") for each in (better, worse))
    assert one is not None
    assert other is not None
    assert other[0] < one[1]
    assert difference(worse, better, "vertex_mean_mm", "") == pytest.approx((1.0, 1.0))
    mixed = clips(tuple(mean + (2.0 if k % 2 else -2.0) for k, mean in enumerate(HARD)))
    low, high = difference(mixed, better, "vertex_mean_mm", "") or (1.0, 1.0)
    assert low < 0.0 < high


def chance_results() -> dict[str, Any]:
    """Results in which the net has the least spread ratio, lbs is alike, and lbs_smooth is worse."""
    results = fake_results()
    alike = tuple(mean + (1.0 if k % 2 else -1.0) for k, mean in enumerate(HARD))
    for name, means in {"net": HARD, "lbs": alike, "lbs_smooth": tuple(m + 9.0 for m in HARD)}.items():
        results["methods"][name]["clips"]["tops"] = clips(means)
    return results


def test_rows_are_sorted_by_spread_ratio_and_chance_is_called_no_difference(tmp_path: Any) -> None:
    results = chance_results()
    rows = {row.method: row for row in standings(results) if row.garment == "tops"}
    assert list(rows)[-1] == "lbs_smooth"
    assert rows["lbs_smooth"].apart
    first, second, _ = rows.values()
    assert first.above is None
    assert not second.apart
    page = write_report(tmp_path, results, [], []).read_text()
    assert page.count("<td>no difference</td>") == 1
    assert ">Spread ratio</th>" in page
    # A method without an ensemble: the mean distance sorts.
    for clip in results["methods"]["net"]["clips"]["tops"].values():
        clip["ensemble_mm"] = None
    means = [row.after.mean_mm for row in standings(results) if row.garment == "tops"]
    assert means == sorted(means)
