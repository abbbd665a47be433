"""From scores per frame to the content of metrics.json (docs/metrics.md describes it field by field)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from evaluate.judge import SIMULATION, CaseScores

Scores = Mapping[str, Tensor]

STAGES = ("_raw", "")
"""Suffixes of what is measured before and after contact."""

SHORT = ("one_step_mm", "rollout_50_mm")
"""Errors that only a method that uses_feedback what it observes has of its own."""

MEANS = (
    "vertex_mse_mm2",
    "vertex_mean_mm",
    "edge_mm",
    "bend_cos",
    "bend_rad",
    "inside_percent",
    "squeezed_percent",
    "inside_faces_percent",
    "skin_percent",
    "crossing_edges_percent",
)
"""What is averaged over the frames, before and after contact."""

LONG = 250
"""Frames from which on a window tells whether a rollout drifts,"""

EARLY, LATE = slice(50, 150), slice(-100, None)
"""and those of its frames that are compared for that."""


@dataclass(frozen=True)
class Entry:
    """What one method scored on one window."""

    action: str
    garment: str
    judged: CaseScores


def summarize(entries: Mapping[str, Sequence[Entry]]) -> dict[str, Any]:
    """The methods and the simulation, by action and garment.

    entries: by method name; those under SIMULATION are the yardstick and go to a key of their own.
    """
    yardstick = _by_action(entries[SIMULATION], entries[SIMULATION])
    methods = {
        name: {
            "actions": _by_action(found, entries[SIMULATION]),
            **{f"over_time_mm{stage}": _over_time(found, f"vertex_mean_mm{stage}") for stage in STAGES},
            "stability": {
                garment: stability([e.judged.scores for e in found if e.garment == garment])
                for garment in dict.fromkeys(entry.garment for entry in found)
            },
        }
        for name, found in entries.items()
        if name != SIMULATION
    }
    return {"methods": methods, SIMULATION: {"actions": yardstick}}


def floor(frames: Mapping[str, Sequence[Scores]], kind: str) -> dict[str, dict[str, float]]:
    """The mean, root mean square and mean square of a floor by garment: {"KIND_mm": ..., ...}.

    frames: by garment, the distance scores of every window; garments without any are left out.
    """
    means, squares = {}, {}
    for garment, windows in frames.items():
        found = [scores for scores in windows if scores]
        if found:
            means[garment] = _mean(found, "vertex_mean_mm")
            squares[garment] = _mean(found, "vertex_mse_mm2")
    return {
        f"{kind}_mm": means,
        f"{kind}_rmse_mm": {garment: square**0.5 for garment, square in squares.items()},
        f"{kind}_mse_mm2": squares,
    }


def stability(windows: Sequence[Scores]) -> dict[str, float | int | None]:
    """Mean errors over all frames of some windows: in one step, in short rollouts and in whole ones.

    What does not feed on itself has the same error in all of them. A score that nothing has is None, as is
    the drift without a long window.
    """
    alike = {f"{key}{stage}": f"vertex_mean_mm{stage}" for key in (*SHORT, "whole_mm") for stage in STAGES}
    windows = [{key: w[own] for key, own in alike.items() if own in w} | dict(w) for w in windows]
    long = [w["vertex_mean_mm"] for w in windows if len(w["vertex_mean_mm"]) >= LONG]
    early, late = (float(sum(errors[span].sum() for errors in long)) for span in (EARLY, LATE))
    return {
        "frames": sum(len(w["vertex_mean_mm"]) for w in windows),
        **{key: _mean(windows, key) if key in windows[0] else None for key in alike},
        "late_over_early": late / early if early > 0 else None,
    }


def _by_action(entries: Sequence[Entry], simulation: Sequence[Entry]) -> dict[str, dict[str, Any]]:
    actions: dict[str, dict[str, Any]] = {}
    for action, garment in dict.fromkeys((entry.action, entry.garment) for entry in entries):
        actions.setdefault(action, {})[garment] = _cell(
            _scores(entries, action, garment), _scores(simulation, action, garment)
        )
    return actions


def _scores(entries: Sequence[Entry], action: str, garment: str) -> list[Scores]:
    return [e.judged.scores for e in entries if (e.action, e.garment) == (action, garment)]


def _cell(scores: Sequence[Scores], simulation: Sequence[Scores]) -> dict[str, float | int | None]:
    """Means over all frames of one action and garment."""
    calm = _mean(simulation, "jitter")
    cell: dict[str, float | int | None] = {
        "frames": sum(len(each["vertex_mean_mm"]) for each in scores),
        "map_mse_mm2": _mean(scores, "map_mse_mm2") if "map_mse_mm2" in scores[0] else None,
    }
    for stage in STAGES:
        cell |= {f"{key}{stage}": _mean(scores, f"{key}{stage}") for key in MEANS}
        cell[f"vertex_rmse_mm{stage}"] = _mean(scores, f"vertex_mse_mm2{stage}") ** 0.5
        # Fewer than three frames have no acceleration.
        cell[f"jitter_ratio{stage}"] = _mean(scores, f"jitter{stage}") / calm if calm > 0 else None
    if "network_ms" in scores[0]:
        network, contact = _mean(scores, "network_ms"), _mean(scores, "contact_ms")
        cell |= {"network_ms": network, "contact_ms": contact, "ms_per_frame": network + contact}
    return cell


def _mean(scores: Sequence[Scores], key: str) -> float:
    values = torch.cat([each[key] for each in scores]).double()
    return float(values.mean()) if len(values) else 0.0


def _over_time(entries: Sequence[Entry], key: str) -> dict[str, list[float]]:
    """The mean of a score at each frame over a garment's windows, while at least half of them last."""
    lines = {}
    for garment in dict.fromkeys(entry.garment for entry in entries):
        windows = [e.judged.scores[key] for e in entries if e.garment == garment]
        padded = torch.nn.utils.rnn.pad_sequence(windows, padding_value=float("nan"))
        enough = padded.isfinite().sum(1) * 2 >= len(windows)
        lines[garment] = [round(float(value), 3) for value in padded.nanmean(1)[enough]]
    return lines
