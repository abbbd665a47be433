"""Intervals over clips: what other clips of the same kind could have given (bootstrap, Efron 1979)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

LEVEL = 0.95
"""Share of the resampled figures that are in an interval."""

LEAST_CLIPS = 4
"""Number of clips below which there is no interval: resamples of fewer are too alike."""

RESAMPLES = 2000

Interval = tuple[float, float]
"""Lowest and highest value."""

Clips = Mapping[str, Mapping[str, float | None]]
"""The figures of a method on a garment by clip, as metrics.json has them."""

SHARES = {"spread_ratio": ("ensemble_mm", "spread_mm")}
"""Figures that are a ratio of two others, before and after the finish; the second has no stage."""


def pooled(clips: Clips, figure: str, stage: str) -> float | None:
    """A figure over all clips, in which all frames have the same weight; None without any."""
    terms = np.array(list(_terms(clips, figure, stage).values()))
    return float(terms[:, 0].sum() / terms[:, 1].sum()) if len(terms) else None


def interval_of(clips: Clips, figure: str, stage: str) -> Interval | None:
    """The interval of a figure over all clips; None with fewer than LEAST_CLIPS of them.

    figure: "vertex_mean_mm" or "spread_ratio". stage: "_raw" before the finish, "" after it.
    """
    return _resampled(list(_terms(clips, figure, stage).values()))


def difference(one: Clips, other: Clips, figure: str, stage: str) -> Interval | None:
    """The interval of the difference of two methods, one minus the other, on the clips that both have.

    The same clips are drawn for both, so that what makes a clip hard for both is left out.
    """
    first, second = (_terms(each, figure, stage) for each in (one, other))
    return _resampled(
        [(value - second[clip][0], weight) for clip, (value, weight) in first.items() if clip in second]
    )


def clip_figures(scores: Sequence[Any], stages: Sequence[str]) -> dict[str, float | None]:
    """The figures of one clip, over the scores per frame of its windows."""

    def mean(key: str) -> float | None:
        values = [score[key] for score in scores if key in score]
        return float(np.concatenate(values).mean(dtype=np.float64)) if values else None

    return {
        "frames": sum(len(each["vertex_mean_mm"]) for each in scores),
        "spread_mm": mean("spread_vertex_mean_mm"),
        **{
            f"{key}{stage}": mean(f"{key}{stage}")
            for stage in stages
            for key in ("vertex_mean_mm", "ensemble_mm")
        },
    }


def _terms(clips: Clips, figure: str, stage: str) -> dict[str, tuple[float, float]]:
    """Numerator and denominator of a figure by clip, so that frames have the same weight."""
    above, below = SHARES.get(figure, (figure, None))
    terms = {}
    for clip, figures in clips.items():
        value, frames = figures.get(f"{above}{stage}"), figures["frames"]
        weight = 1.0 if below is None else figures.get(below)
        if value is not None and weight is not None and frames:
            terms[clip] = frames * value, frames * weight
    return terms


def _resampled(terms: Sequence[tuple[float, float]]) -> Interval | None:
    """The interval of a ratio of sums over resampled clips."""
    if len(terms) < LEAST_CLIPS:
        return None
    # Imported here: it takes a second, which reports of fewer clips do not need.
    from scipy.stats import bootstrap

    drawn = bootstrap(
        tuple(np.array(terms).T),
        lambda above, below, axis: above.sum(axis) / below.sum(axis),
        paired=True,
        vectorized=True,
        n_resamples=RESAMPLES,
        confidence_level=LEVEL,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return float(drawn.low), float(drawn.high)
