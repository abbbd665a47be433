"""The first screen of a report: three questions, answered in words and one picture each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from .charts import bars, number
from .intervals import LEAST_CLIPS
from .standings import Results, Standing, cells, mean_of, standings

NEARLY = 1.1
"""Factor on the least error up to which a faster method is named beside the closest one."""


@dataclass(frozen=True)
class Answer:
    """A question, its answer in sentences, and a chart, or None where nothing was measured."""

    question: str
    sentences: tuple[str, ...]
    chart: Markup | None


def answers(results: Results) -> list[Answer]:
    """Answers to three questions: which method for what, at which cost, how far from chance."""
    rows = standings(results)
    by_garment = {row.garment: [each for each in rows if each.garment == row.garment] for row in rows}
    return [_which(results, by_garment), _cost(results, by_garment), _chance(results, by_garment)]


def one_person(results: Results) -> str:
    """A sentence where all windows are of one person, or else nothing."""
    people = results["people"]
    if len(people) != 1 or results["windows"] < 2:
        return ""
    return f"All windows are of one person ({people[0]}): no figure says how it is for others."


def _which(results: Results, by_garment: Mapping[str, Sequence[Standing]]) -> Answer:
    closest, following, lively = [], [], []
    for garment, rows in by_garment.items():
        first, *others = sorted(rows, key=lambda row: row.after.mean_mm)
        says = f"{number(first.after.mean_mm)} mm"
        if first.after.against:
            share = round(100 * (1 - first.after.against))
            says += f", {abs(share)} % {'less' if share >= 0 else 'more'} than the better LBS"
        closest.append((first.method, garment, says))
        following += [(row.method, garment, f"{number(row.after.mean_mm)} mm") for row in others[:1]]
        swings = {row.method: _figure(results, row.method, garment, "swing_ratio") for row in rows}
        known = {name: swing for name, swing in swings.items() if swing is not None}
        if known:
            name = min(known, key=lambda each: abs(known[each] - 1.0))
            lively.append((name, garment, f"{number(known[name])} of it"))
    sentences = [
        f"{title}: {_listed(each)}."
        for title, each in (
            ("Closest to the simulation", closest),
            ("Next", following),
            ("Nearest to its swing", lively),
        )
        if each
    ]
    errors = {
        garment: {row.method: row.after.mean_mm for row in rows} for garment, rows in by_garment.items()
    }
    return Answer("Which method for what?", tuple(sentences), _bars(results, "Mean distance", errors, "mm"))


def _cost(results: Results, by_garment: Mapping[str, Sequence[Standing]]) -> Answer:
    times = {
        garment: {row.method: _figure(results, row.method, garment, "ms_per_frame") for row in rows}
        for garment, rows in by_garment.items()
    }
    closest, faster = [], []
    for garment, rows in by_garment.items():
        errors = {row.method: row.after.mean_mm for row in rows}
        known = {name: ms for name, ms in times[garment].items() if ms is not None}
        if not known:
            continue
        best = min(known, key=lambda name: errors[name])
        closest.append((best, garment, f"{number(known[best])} ms"))
        near = [name for name in known if errors[name] <= NEARLY * errors[best]]
        fastest = min(near, key=lambda name: known[name])
        if fastest != best:
            faster.append((fastest, garment, f"{number(known[fastest])} ms"))
    fps = results["fps"]
    sentences = [f"At {fps:g} frames per second there are {number(1000 / fps)} ms for each one."]
    if closest:
        sentences += [
            f"The closest method takes: {_listed(closest)}.",
            f"Faster, with at most a tenth more error: {_listed(faster)}."
            if faster
            else "No faster one has at most a tenth more error.",
        ]
    return Answer("At which cost?", tuple(sentences), _bars(results, "Time of a frame", times, "ms"))


def _listed(entries: Sequence[tuple[str, str, str]]) -> str:
    """Methods, garments and what is said of each pair, by method, in words."""
    garments: dict[str, list[str]] = {}
    for method, garment, says in entries:
        garments.setdefault(method, []).append(f"{garment} ({says})")
    return "; ".join(f"{method} for {', '.join(each)}" for method, each in garments.items())


def _chance(results: Results, by_garment: Mapping[str, Sequence[Standing]]) -> Answer:
    ratios = {garment: {row.method: row.spread_ratio for row in rows} for garment, rows in by_garment.items()}
    having = {garment: rows for garment, rows in by_garment.items() if any(row.spread_ratio for row in rows)}
    sentences = [one] if (one := one_person(results)) else []
    nearest = []
    for garment, rows in having.items():
        known = {row.method: row.spread_ratio for row in rows if row.spread_ratio is not None}
        name = min(known, key=lambda each: known[each])
        nearest.append((name, garment, f"{number(known[name])} times"))
    if nearest:
        sentences.append(
            f"Nearest: {_listed(nearest)} as far from the simulations as these are from each other."
        )
    if having:
        floors = {"another simulation": 1.0}
        chart = _bars(results, "Spread ratio (dashed: chance)", ratios, "", floors)
        return Answer("How far from chance?", tuple(sentences), chart)
    sentences.append(
        "Not known: no window was simulated more than once (uvcloth simulate --ensemble). Two simulations of "
        "one window may be as far apart as two methods."
    )
    clips = {row.clips for rows in by_garment.values() for row in rows}
    if min(clips) < LEAST_CLIPS:
        sentences.append(
            f"There are fewer than {LEAST_CLIPS} clips of a garment: an order of methods that changes from "
            "action to action says nothing."
        )
    return Answer("How far from chance?", tuple(sentences), _by_clip(results, list(by_garment)))


def _figure(results: Results, method: str, garment: str, key: str) -> float | None:
    """A figure of a method on a garment over all actions."""
    return mean_of(cells(results["methods"][method], garment).values(), key)


def _bars(
    results: Results,
    title: str,
    figures: Mapping[str, Mapping[str, float | None]],
    unit: str,
    floors: Mapping[str, float] | None = None,
) -> Markup | None:
    """A bar for each garment and method that has a figure."""
    names = list(results["methods"])
    rows = {garment: [each.get(name) for name in names] for garment, each in figures.items()}
    rows = {garment: row for garment, row in rows.items() if any(value is not None for value in row)}
    return bars(title, rows, names, unit, floors or {}) if rows else None


def _by_clip(results: Results, garments: Sequence[str]) -> Markup | None:
    """The mean distance in each action, of the garment with most of them."""
    judged = {
        garment: {name: cells(method, garment) for name, method in results["methods"].items()}
        for garment in garments
    }
    actions = {
        garment: {
            action: {name: cell[action]["vertex_mean_mm"] for name, cell in by.items() if action in cell}
            for action in dict.fromkeys(action for cell in by.values() for action in cell)
        }
        for garment, by in judged.items()
    }
    garment = max(actions, key=lambda each: len(actions[each]))
    return _bars(results, f"{garment}, action by action", actions[garment], "mm")
