"""From scores per frame to the content of metrics.json (docs/metrics.md describes it field by field)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from .candidates import SIMULATION
from .intervals import clip_figures
from .judge import MEMBER_SUFFIX, REPRESENTED, Scores
from .look_fields import look_fields, turned_fields
from .metrics import wrong_side_key

STAGE_SUFFIXES = ("_raw", "")
"""Suffixes of scores before and after the finish."""

SHORT = ("one_step_mm", "rollout_50_mm")
"""Fields of errors that differ from whole rollouts only for methods that use feedback."""

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
    "skin_pixels_percent",
    "cloth_pixels_percent",
    "crossing_edges_percent",
)
"""Scores that are averaged over the frames, before and after the finish."""

LONG = 250
"""Least number of frames of a window in which drift is measured."""

EARLY, LATE = slice(50, 150), slice(-100, None)
"""Frames of a long window whose errors are compared for the drift."""

FIGURES = {
    "mm": ("vertex_mean_mm", 1.0),
    "rmse_mm": ("vertex_mse_mm2", 0.5),
    "mse_mm2": ("vertex_mse_mm2", 1.0),
}
"""The three figures of a floor: the distance score that is averaged, and the power of its mean."""

SPREAD = "spread_"
"""Prefix of the distance scores of an ensemble's members."""


@dataclass(frozen=True)
class PartScores:
    """The scores of one method on one part, a garment or a whole outfit, in one case, of a clip."""

    action: str
    part: str
    scores: Scores
    clip: str


def summarize(
    entries: Mapping[str, Sequence[PartScores]], outfits: Mapping[str, Sequence[str]]
) -> dict[str, Any]:
    """The methods and the simulation, by action and garment, and by outfit and action.

    entries: by method name; those under SIMULATION are the reference and get a key of their own. outfits:
    by name, the garments of those that have several, the innermost first.
    """
    simulation = entries[SIMULATION]

    def summarized(scores: Sequence[PartScores]) -> dict[str, Any]:
        single = [entry for entry in scores if entry.part not in outfits]
        judged = [name for name in outfits if any(entry.part == name for entry in scores)]
        whole = {name: [entry for entry in scores if entry.part == name] for name in judged}
        return {
            **_tables(single, simulation),
            "representation": _represented(single),
            "outfits": {name: _outfit(whole[name], simulation, outfits[name]) for name in judged},
        }

    yardstick = summarized(simulation)
    return {
        "methods": {name: summarized(scores) for name, scores in entries.items() if name != SIMULATION},
        SIMULATION: {
            "actions": yardstick["actions"],
            "stop_energy_mj_kg": yardstick["stop_energy_mj_kg"],
            "outfits": {name: {"actions": each["actions"]} for name, each in yardstick["outfits"].items()},
        },
    }


def repeatability_floor(simulation: Sequence[PartScores]) -> dict[str, dict[str, float]]:
    """By garment, the distance of an ensemble's members from each other: {"repeatability_mm": ..., ...}.

    simulation: its scores of garments; those without an ensemble are left out.
    """
    figures = _by_garment(simulation, SPREAD)
    return {
        f"repeatability_{unit}": {garment: each[unit] for garment, each in figures.items()}
        for unit in FIGURES
    }


def representation_floor(methods: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """By garment, the least that a method's own representation loses: {"representation_mm": ..., ...}."""
    represented = [method["representation"] for method in methods.values()]
    garments = dict.fromkeys(garment for by_garment in represented for garment in by_garment)
    return {
        f"representation_{unit}": {
            garment: min(by[garment][unit] for by in represented if garment in by) for garment in garments
        }
        for unit in FIGURES
    }


def stability(windows: Sequence[Scores]) -> dict[str, float | int | None]:
    """Mean errors over all frames of some windows: in one step, in short rollouts and in whole ones.

    A method without feedback has the same error in all of them. A score without values is None, as is the
    drift without a long window.
    """
    alike = {
        f"{key}{stage}": f"vertex_mean_mm{stage}" for key in (*SHORT, "whole_mm") for stage in STAGE_SUFFIXES
    }
    windows = [{key: w[source] for key, source in alike.items() if source in w} | dict(w) for w in windows]
    long = [w["vertex_mean_mm"] for w in windows if len(w["vertex_mean_mm"]) >= LONG]
    early, late = (float(sum(errors[span].sum() for errors in long)) for span in (EARLY, LATE))
    return {
        "frames": sum(len(w["vertex_mean_mm"]) for w in windows),
        **{key: _mean(windows, key) if key in windows[0] else None for key in alike},
        "late_over_early": late / early if early > 0 else None,
    }


def _tables(entries: Sequence[PartScores], simulation: Sequence[PartScores]) -> dict[str, Any]:
    """The tables of a method in metrics.json, by part."""
    parts = {
        part: [entry.scores for entry in entries if entry.part == part]
        for part in dict.fromkeys(entry.part for entry in entries)
    }
    return {
        "actions": _by_action(entries, simulation),
        **{
            f"over_time_mm{stage}": {
                part: _over_time([scores[f"vertex_mean_mm{stage}"] for scores in windows])
                for part, windows in parts.items()
            }
            for stage in STAGE_SUFFIXES
        },
        "stability": {part: stability(windows) for part, windows in parts.items()},
        "clips": {part: _by_clip([each for each in entries if each.part == part]) for part in parts},
        **{
            f"stop_energy_mj_kg{stage}": {
                part: _over_time(
                    [window[key] for window in windows if (key := f"stop_energy{stage}") in window]
                )
                for part, windows in parts.items()
            }
            for stage in STAGE_SUFFIXES
        },
    }


def _by_clip(entries: Sequence[PartScores]) -> dict[str, dict[str, float | None]]:
    """The figures of a part by clip, for intervals."""
    clips = dict.fromkeys(entry.clip for entry in entries)
    return {
        clip: clip_figures([entry.scores for entry in entries if entry.clip == clip], STAGE_SUFFIXES)
        for clip in clips
    }


def _outfit(
    entries: Sequence[PartScores], simulation: Sequence[PartScores], garments: Sequence[str]
) -> dict[str, Any]:
    """The tables of one outfit as a whole, with the vertices on the wrong side in each action."""
    tables = _tables(entries, simulation)
    (name,) = tables["stability"]
    cells = {action: by_part[name] for action, by_part in tables["actions"].items()}
    return {
        **{key: by_part[name] for key, by_part in tables.items() if key != "actions"},
        "actions": {
            action: cell | _sides([e.scores for e in entries if e.action == action], garments)
            for action, cell in cells.items()
        },
    }


def _sides(scores: Sequence[Scores], garments: Sequence[str]) -> dict[str, dict[str, dict[str, float]]]:
    """Vertices on the wrong side, percent, by outer and inner garment, before and after the finish."""
    return {
        f"wrong_side_percent{stage}": {
            outer: {inner: _mean(scores, wrong_side_key(outer, inner) + stage) for inner in garments[:index]}
            for index, outer in enumerate(garments)
            if index
        }
        for stage in STAGE_SUFFIXES
    }


def _represented(entries: Sequence[PartScores]) -> dict[str, dict[str, float | None]]:
    """The figures of a method's own representation by garment, those of a floor and the swing."""
    having = [entry for entry in entries if f"{REPRESENTED}swing_speed" in entry.scores]
    swings = {
        garment: swing([_without(entry.scores, REPRESENTED) for entry in having if entry.part == garment])
        for garment in dict.fromkeys(entry.part for entry in having)
    }
    return {
        garment: {**each, **swings.get(garment, {})}
        for garment, each in _by_garment(entries, REPRESENTED).items()
    }


def _without(scores: Scores, prefix: str) -> Scores:
    """The scores with a prefix, under their names without it."""
    return {key.removeprefix(prefix): values for key, values in scores.items() if key.startswith(prefix)}


def _by_garment(entries: Sequence[PartScores], prefix: str) -> dict[str, dict[str, float]]:
    """The three figures of a floor by garment, from the scores with a prefix; empty if nothing has them."""
    by_garment: dict[str, list[Scores]] = {}
    for entry in entries:
        if f"{prefix}vertex_mean_mm" in entry.scores:
            by_garment.setdefault(entry.part, []).append(entry.scores)
    return {
        garment: {unit: _mean(windows, f"{prefix}{key}") ** power for unit, (key, power) in FIGURES.items()}
        for garment, windows in by_garment.items()
    }


def _by_action(entries: Sequence[PartScores], simulation: Sequence[PartScores]) -> dict[str, dict[str, Any]]:
    """A cell for each action and part."""
    actions: dict[str, dict[str, Any]] = {}
    for action, part in dict.fromkeys((entry.action, entry.part) for entry in entries):
        actions.setdefault(action, {})[part] = _cell(
            *(
                [each for each in those if (each.action, each.part) == (action, part)]
                for those in (entries, simulation)
            )
        )
    return actions


def _cell(entries: Sequence[PartScores], true: Sequence[PartScores]) -> dict[str, Any]:
    """Means over all frames of one action and part. true: the entries of the simulation."""
    scores, simulation = ([entry.scores for entry in each] for each in (entries, true))
    clips = [entry.clip for entry in entries]
    calm = _mean(simulation, "jitter")
    cell: dict[str, Any] = {
        "frames": sum(len(each["vertex_mean_mm"]) for each in scores),
        "map_mse_mm2": _mean(scores, "map_mse_mm2") if "map_mse_mm2" in scores[0] else None,
    }
    for stage in STAGE_SUFFIXES:
        cell |= {f"{key}{stage}": _mean(scores, f"{key}{stage}") for key in MEANS}
        cell[f"vertex_rmse_mm{stage}"] = _mean(scores, f"vertex_mse_mm2{stage}") ** 0.5
        # Fewer than three frames have no acceleration.
        cell[f"jitter_ratio{stage}"] = _mean(scores, f"jitter{stage}") / calm if calm > 0 else None
        cell |= swing(scores, stage) | _chance(scores, stage)
        cell |= look_fields(scores, simulation, clips, stage)
    cell |= turned_fields(scores)
    if any(f"swing_speed{MEMBER_SUFFIX}" in score for score in scores):
        cell |= _member_fields(entries)
    if all("network_ms" in each for each in scores):
        network, contact = _mean(scores, "network_ms"), _mean(scores, "contact_ms")
        cell |= {"network_ms": network, "contact_ms": contact, "ms_per_frame": network + contact}
    return cell


def swing(scores: Sequence[Scores], stage: str = "") -> dict[str, float | None]:
    """Ratio of the swing's speed to the simulation's, and the correlation of both; None without motion.

    scores: of some windows, as `swing_scores` has them. stage: one of STAGE_SUFFIXES.
    """

    def total(key: str) -> float:
        return float(torch.cat([score[f"{key}{stage}"] for score in scores]).double().sum())

    speed, squares = total("true_swing_speed"), total("swing_square") * total("true_swing_square")
    return {
        f"swing_ratio{stage}": total("swing_speed") / speed if speed > 0 else None,
        f"swing_correlation{stage}": total("swing_product") / squares**0.5 if squares > 0 else None,
    }


def _member_fields(simulation: Sequence[PartScores]) -> dict[str, Any]:
    """Swing and looks of another simulation, over the windows that have an ensemble."""
    having = [each for each in simulation if f"swing_speed{MEMBER_SUFFIX}" in each.scores]
    scores, clips = [each.scores for each in having], [each.clip for each in having]
    return swing(scores, MEMBER_SUFFIX) | look_fields(scores, scores, clips, MEMBER_SUFFIX)


def _chance(scores: Sequence[Scores], stage: str) -> dict[str, float | None]:
    """Distances from an ensemble of simulations over the windows that have one, None without any.

    spread_ratio: the mean distance from the members over their distance from each other. energy_score_mm:
    over the windows with several rollouts.
    """
    energy = [score for score in scores if "energy_score_mm" in score]
    scores = [each for each in scores if f"ensemble_mm{stage}" in each]
    ensemble, nearest = (
        _mean(scores, f"{key}{stage}") if scores else None for key in ("ensemble_mm", "nearest_member_mm")
    )
    spread = _mean(scores, f"{SPREAD}vertex_mean_mm") if scores else 0.0
    return {
        **({} if stage else {"energy_score_mm": _mean(energy, "energy_score_mm") if energy else None}),
        f"ensemble_mm{stage}": ensemble,
        f"nearest_member_mm{stage}": nearest,
        f"spread_ratio{stage}": ensemble / spread if ensemble is not None and spread > 0 else None,
    }


def _mean(scores: Sequence[Scores], key: str) -> float:
    """The mean of one score over all frames; 0 without any."""
    values = torch.cat([score[key] for score in scores]).double()
    return float(values.mean()) if len(values) else 0.0


def _over_time(windows: Sequence[Tensor]) -> list[float]:
    """The mean of a score (F,) of several windows at each frame, while at least half of them last.

    Nothing without a window.
    """
    if not windows:
        return []
    padded = torch.nn.utils.rnn.pad_sequence(list(windows), padding_value=float("nan"))
    enough = padded.isfinite().sum(1) * 2 >= len(windows)
    return [round(float(value), 3) for value in padded.nanmean(1)[enough]]
