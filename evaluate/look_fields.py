"""Fields of metrics.json on motion and looks, from the scores of a method and of the simulation."""

from collections.abc import Sequence
from itertools import pairwise
from operator import itemgetter
from typing import Any

import torch
from torch import Tensor

from .force_balance import MOST_FORCE
from .judge import Scores
from .swing_bands import BANDS
from .wrinkles import WAVELENGTHS

_MM = [round(1000 * wavelength) for wavelength in WAVELENGTHS]

WAVES = (
    f"over_{_MM[0]}_mm",
    *(f"{short}_{long}_mm" for long, short in pairwise(_MM)),
    f"under_{_MM[-1]}_mm",
)
"""Names of the bands of wavelength."""

LEAST_RATIO = 0.01
"""Ratio of a swing to the simulation's below which its direction is that of rounding errors."""

NAMED_FRAMES = 10
"""Most frames that are named, those with the largest forces."""


def look_fields(
    windows: Sequence[Scores], simulation: Sequence[Scores], clips: Sequence[str], stage: str
) -> dict[str, Any]:
    """The fields of one stage over some windows; None where nothing can be measured.

    simulation: its scores of the same windows. clips: the name of each. stage: suffix of the scores.
    """
    return {
        f"{key}{stage}": value
        for key, value in {
            **_bands(windows, stage),
            **_wrinkles(windows, simulation, stage),
            "hem_roughness": _over(
                _mean(windows, f"hem_roughness_mm{stage}"), _mean(simulation, "hem_roughness_mm")
            ),
            "hem_energy": _over(_mean(windows, f"hem_square{stage}"), _mean(simulation, "hem_square")),
            "popping": _over(_largest(windows, stage), _largest(simulation, "")),
            **_forces(windows, clips, stage),
            "stop_energy": _over(_mean(windows, f"stop_energy{stage}"), _mean(simulation, "stop_energy")),
            "settle_s": _mean(windows, f"settle_s{stage}"),
        }.items()
    }


def turned_fields(windows: Sequence[Scores]) -> dict[str, float | None]:
    """Mean and largest distance of a turned rollout from the rollout, turned, mm."""
    farthest = _values(windows, "turned_max_mm")
    return {
        "turned_mm": _mean(windows, "turned_mm"),
        "turned_max_mm": float(farthest.max()) if len(farthest) else None,
    }


def _bands(windows: Sequence[Scores], stage: str) -> dict[str, float | None]:
    """Ratio and correlation of swing in each band, over the windows that measure it."""
    squares, truths, products = (
        _values(windows, f"{key}{stage}").reshape(-1, len(BANDS)).nansum(0).tolist()
        for key in ("band_square", "true_band_square", "band_product")
    )
    fields: dict[str, float | None] = {}
    for (low, high), square, truth, product in zip(BANDS, squares, truths, products, strict=True):
        ratio = (square / truth) ** 0.5 if truth > 0 else None
        agrees = product / (square * truth) ** 0.5 if ratio is not None and ratio > LEAST_RATIO else None
        fields |= {f"swing_ratio_{low}_{high}_hz": ratio, f"swing_correlation_{low}_{high}_hz": agrees}
    return fields


def _wrinkles(windows: Sequence[Scores], simulation: Sequence[Scores], stage: str) -> dict[str, float | None]:
    """Root mean square offset in each band of wavelength over the simulation's."""
    squares, truths = (
        _values(each, key).reshape(-1, len(WAVES)).sum(0)
        for each, key in ((windows, f"wrinkle_mm2{stage}"), (simulation, "wrinkle_mm2"))
    )
    return {
        f"wrinkles_{name}": (float(square) / float(truth)) ** 0.5 if truth > 0 else None
        for name, square, truth in zip(WAVES, squares, truths, strict=True)
    }


def _forces(windows: Sequence[Scores], clips: Sequence[str], stage: str) -> dict[str, Any]:
    """Means of the unbalanced force, and the frames that no cloth can take."""
    named: list[dict[str, Any]] = [
        {"clip": clip, "frame": int(frame), "force": round(float(force), 1)}
        for clip, scores in zip(clips, windows, strict=True)
        if f"force_median{stage}" in scores
        for frame, force in zip(scores[f"force_frame{stage}"], scores[f"force_median{stage}"], strict=True)
        if force > MOST_FORCE
    ]
    measured = int(_values(windows, f"force_median{stage}").isfinite().sum())
    worst = sorted(named, key=itemgetter("force"), reverse=True)
    return {
        "force_median": _mean(windows, f"force_median{stage}"),
        "force_99": _mean(windows, f"force_99{stage}"),
        "impossible_percent": 100.0 * len(named) / measured if measured else None,
        "impossible_frames": worst[:NAMED_FRAMES],
    }


def _largest(windows: Sequence[Scores], stage: str) -> float | None:
    """Mean over windows of the largest acceleration."""
    peaks = [values.max() for window in windows if len(values := window[f"peak_acceleration{stage}"])]
    return float(torch.stack(peaks).mean()) if peaks else None


def _mean(windows: Sequence[Scores], key: str) -> float | None:
    """Mean of the finite values of a score; None without any."""
    values = _values(windows, key)
    values = values[values.isfinite()]
    return float(values.mean()) if len(values) else None


def _values(windows: Sequence[Scores], key: str) -> Tensor:
    """The values of a score of the windows that have it."""
    having = [window[key].double() for window in windows if key in window]
    return torch.cat(having) if having else torch.zeros(0).double()


def _over(value: float | None, truth: float | None) -> float | None:
    """A ratio, None if there is none."""
    return value / truth if value is not None and truth else None
