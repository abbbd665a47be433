"""Standings: methods over all actions, on each garment and outfit, beside the baselines."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from .candidates import SIMULATION
from .intervals import Clips, Interval, difference, interval_of, pooled

Results = Mapping[str, Any]
"""The content of metrics.json, as docs/metrics.md describes it."""

FIGURES = ("spread_ratio", "vertex_mean_mm")
"""Figures with intervals over clips; rows are sorted by the first that all methods have."""

STAGES = {"before": "_raw", "after": ""}
"""Before and after the finish: the suffixes of the fields."""

OUTFIT = {
    "vertex_mean_mm": "Mean (mm)",
    "vertex_rmse_mm": "RMSE (mm)",
    "skin_percent": "Skin that shows (%)",
    "crossing_edges_percent": "Edges through cloth (%)",
}
"""Titles of the fields of an outfit as a whole."""


@dataclass(frozen=True)
class OutfitRow:
    """An outfit of several garments as one, over all actions, by one method or the simulation.

    figures: by field of metrics.json. sides: by "OUTER over INNER", vertices on the wrong side, percent,
    before and after the finish.
    """

    outfit: str
    method: str
    figures: Mapping[str, float | None]
    sides: Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class Rank:
    """The mean distance from the simulation, before or after the finish, over all actions.

    against: mean distance divided by that of the better baseline (LBS), None for a baseline or without one.
    won, of: actions on which its error is lower than that of the better baseline of that action.
    """

    mean_mm: float
    rmse_mm: float | None
    against: float | None
    won: int
    of: int


@dataclass(frozen=True)
class Standing:
    """The ranks of one method on one garment, or one outfit of several, over all actions.

    clips: their number. spread_ratio: after the finish, None without an ensemble. intervals: of spread ratio
    and mean distance after the finish, by FIGURES, None with too few clips. above: interval of the difference
    from the row above, in the figure that the rows are sorted by; None in the first row too.
    """

    method: str
    garment: str
    frames: int
    clips: int
    before: Rank
    after: Rank
    spread_ratio: float | None
    intervals: Mapping[str, Interval | None]
    above: Interval | None = None

    @property
    def apart(self) -> bool:
        """True where the difference from the row above is not chance, as far as it is known."""
        return self.above is not None and not self.above[0] <= 0.0 <= self.above[1]


def garments_in(results: Results) -> list[str]:
    """The garments that any method was judged on, in the order in which they first appear."""
    garments = [t for m in results["methods"].values() for a in m["actions"].values() for t in a]
    return list(dict.fromkeys(garments))


def methods_on(results: Results, garment: str) -> list[str]:
    """The methods that were judged on a garment or an outfit: those that support it."""
    return [name for name, method in results["methods"].items() if cells(method, garment)]


def cells(method: Results, garment: str) -> dict[str, Mapping[str, Any]]:
    """The scores of a method, or the simulation, on a garment or an outfit of several, by action."""
    if garment in method["outfits"]:
        return dict(method["outfits"][garment]["actions"])
    return {action: by[garment] for action, by in method["actions"].items() if garment in by}


def actions_in(results: Results, garment: str) -> list[str]:
    """The actions on which any method was judged with a garment."""
    actions = [
        action
        for method in results["methods"].values()
        for action, by_garment in method["actions"].items()
        if garment in by_garment
    ]
    return list(dict.fromkeys(actions))


def overall(actions: Mapping[str, Mapping[str, Mapping[str, float]]], garment: str, key: str) -> float | None:
    """The mean of one measure over all actions of a garment; None if there is none, see `mean_of`."""
    return mean_of([by[garment] for by in actions.values() if garment in by], key)


def mean_of(actions: Iterable[Mapping[str, float]], key: str) -> float | None:
    """The mean of one measure over some actions, weighted by frames; None if there is none.

    A root mean square averages as its square.
    """
    having = [cell for cell in actions if cell.get(key) is not None]
    frames = sum(cell["frames"] for cell in having)
    if not frames:
        return None
    power = 2 if "rmse" in key else 1
    mean = sum(cell["frames"] * cell[key] ** power for cell in having) / frames
    return float(mean ** (1 / power))


def standings(results: Results) -> list[Standing]:
    """Every method on every garment, then on every outfit of several, beside the better baseline.

    The rows of a garment are sorted by spread ratio, or by mean distance where a method has no spread ratio.
    """
    return [
        row
        for garment in (*garments_in(results), *results["outfits"])
        for row in _sorted(
            results, [_standing(results, name, garment) for name in methods_on(results, garment)]
        )
    ]


def clips_of(method: Results, garment: str) -> Clips:
    """The figures by clip of a method on a garment or an outfit of several."""
    clips: Clips = (
        method["outfits"][garment]["clips"] if garment in method["outfits"] else method["clips"][garment]
    )
    return clips


def _standing(results: Results, name: str, garment: str) -> Standing:
    method = results["methods"][name]
    clips = clips_of(method, garment)
    return Standing(
        method=name,
        garment=garment,
        frames=sum(cell["frames"] for cell in cells(method, garment).values()),
        clips=len(clips),
        spread_ratio=pooled(clips, "spread_ratio", ""),
        intervals={figure: interval_of(clips, figure, "") for figure in FIGURES},
        before=_rank(results, name, garment, STAGES["before"]),
        after=_rank(results, name, garment, STAGES["after"]),
    )


def _sorted(results: Results, rows: Sequence[Standing]) -> list[Standing]:
    """The rows of a garment, the best first, each compared with the one above it."""
    ratios = all(row.spread_ratio is not None for row in rows)
    figure = "spread_ratio" if ratios else "vertex_mean_mm"
    ordered = sorted(rows, key=lambda row: row.spread_ratio or 0.0 if ratios else row.after.mean_mm)
    clips = [clips_of(results["methods"][row.method], row.garment) for row in ordered]
    above = [difference(clips[k], clips[k - 1], figure, "") if k else None for k in range(len(clips))]
    return [replace(row, above=apart) for row, apart in zip(ordered, above, strict=True)]


def outfit_rows(results: Results) -> list[OutfitRow]:
    """For every outfit of several garments the simulation, then every method that supports it."""
    everyone = {SIMULATION: results[SIMULATION], **results["methods"]}
    return [
        OutfitRow(
            outfit=outfit,
            method=name,
            figures={
                key + suffix: mean_of(actions, key + suffix) for suffix in STAGES.values() for key in OUTFIT
            }
            | {"ms_per_frame": mean_of(actions, "ms_per_frame")},
            sides=_sides(actions),
        )
        for outfit in results["outfits"]
        for name, judged in everyone.items()
        if (actions := list(cells(judged, outfit).values()))
    ]


def _sides(actions: Sequence[Mapping[str, Any]]) -> dict[str, tuple[float, float]]:
    """The shares on the wrong side over some actions, weighted by frames, before and after the finish."""

    def mean(key: str, outer: str, inner: str) -> float:
        total = sum(cell["frames"] * cell[key][outer][inner] for cell in actions)
        return float(total / sum(cell["frames"] for cell in actions))

    return {
        f"{outer} over {inner}": (
            mean("wrong_side_percent_raw", outer, inner),
            mean("wrong_side_percent", outer, inner),
        )
        for outer, beneath in actions[0]["wrong_side_percent"].items()
        for inner in beneath
    }


def _rank(results: Results, name: str, garment: str, suffix: str) -> Rank:
    """The rank of a method on a garment or an outfit. suffix: of the fields, "_raw" before the finish."""
    methods = results["methods"]
    baselines = [other for other, method in methods.items() if method["baseline"]]
    mean_key, rmse_key = f"vertex_mean_mm{suffix}", f"vertex_rmse_mm{suffix}"
    scored = {other: cells(methods[other], garment) for other in (*baselines, name)}
    means = {
        other: mean for other, by in scored.items() if (mean := mean_of(by.values(), mean_key)) is not None
    }
    best = min((means[other] for other in baselines if other in means), default=0.0)
    judged = name not in baselines and best > 0
    duels = [
        (cell[mean_key], min(others))
        for action, cell in scored[name].items()
        if (others := [scored[b][action][mean_key] for b in baselines if action in scored[b]])
    ]
    return Rank(
        mean_mm=means[name],
        rmse_mm=mean_of(scored[name].values(), rmse_key),
        against=means[name] / best if judged else None,
        won=sum(error < other for error, other in duels) if judged else 0,
        of=len(duels) if judged else 0,
    )
