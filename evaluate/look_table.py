"""The table of motion and looks in the report, and the frames that no cloth can take."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any

from .candidates import SIMULATION
from .charts import DASH, number
from .judge import MEMBER_SUFFIX
from .look_fields import WAVES
from .standings import Results, garments_in, methods_on, overall
from .swing_bands import BANDS

GROUPS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "Swing ÷ simulation's (correlation)": {
        f"{low}{DASH}{high} Hz": (f"swing_ratio_{low}_{high}_hz", f"swing_correlation_{low}_{high}_hz")
        for low, high in BANDS
    },
    "Wrinkles ÷ simulation's": {
        wave.replace("_mm", " mm").replace("_", DASH if wave[0].isdigit() else " "): (f"wrinkles_{wave}",)
        for wave in WAVES
    },
    "Hems ÷ simulation's": {"roughness": ("hem_roughness",), "energy": ("hem_energy",)},
    "Popping": {"÷ sim.": ("popping",)},
    "Unbalanced force": {
        "median (m/s²)": ("force_median",),
        "99 % (m/s²)": ("force_99",),
        "impossible (% of frames)": ("impossible_percent",),
    },
    "After a stop": {"energy ÷ sim.": ("stop_energy",), "settles (s)": ("settle_s",)},
    "Turned scene": {"mean (mm)": ("turned_mm",), "largest (mm)": ("turned_max_mm",)},
}
"""Columns by group and title: a field of metrics.json, or two of which the second stands in brackets."""


@dataclass(frozen=True)
class LookRow:
    """The looks of a garment by one method, after the finish, or by a simulation. figures: one per column."""

    garment: str
    method: str
    figures: Sequence[str]
    simulated: bool = False


@dataclass(frozen=True)
class LookTable:
    """The table, without columns that have no figure. groups: by title, places in rows by title."""

    groups: Mapping[str, Mapping[str, int]]
    rows: Sequence[LookRow]


def look_table(results: Results) -> LookTable:
    """For every garment the simulation, another one if there is an ensemble, and each method."""
    rows = _look_rows(results)
    columns = zip(*(row.figures for row in rows), strict=True)
    filled = [any(figure != DASH for figure in column) for column in columns]
    titles = [(group, title) for group, each in GROUPS.items() for title in each]
    groups: dict[str, dict[str, int]] = {}
    for place, (group, title) in enumerate(compress(titles, filled)):
        groups.setdefault(group, {})[title] = place
    return LookTable(groups, [replace(row, figures=list(compress(row.figures, filled))) for row in rows])


def _look_rows(results: Results) -> list[LookRow]:
    """The rows, with a figure or a dash in every column."""
    rows = []
    for garment in garments_in(results):
        true = results[SIMULATION]["actions"]
        rows.append(LookRow(garment, SIMULATION, _figures(true, garment, ""), simulated=True))
        if overall(true, garment, f"swing_ratio{MEMBER_SUFFIX}") is not None:
            figures = _figures(true, garment, MEMBER_SUFFIX)
            rows.append(LookRow(garment, "another simulation", figures, simulated=True))
        rows += [
            LookRow(garment, name, _figures(results["methods"][name]["actions"], garment, ""))
            for name in methods_on(results, garment)
        ]
    return rows


def impossible_frames(results: Results) -> dict[str, list[str]]:
    """By method, the worst frames that no cloth can take, after the finish, in words."""
    named = {
        name: [
            f"{each['clip']}, {garment}: frame {each['frame']} ({number(each['force'])} m/s²)"
            for by_garment in method["actions"].values()
            for garment, cell in by_garment.items()
            for each in cell.get("impossible_frames", ())
        ]
        for name, method in results["methods"].items()
    }
    return {name: frames for name, frames in named.items() if frames}


def _figures(actions: Mapping[str, Any], garment: str, suffix: str) -> list[str]:
    """The figures of a row. suffix: of the fields."""
    columns = [keys for group in GROUPS.values() for keys in group.values()]
    values = [[overall(actions, garment, key + suffix) for key in keys] for keys in columns]
    return [_pair(*value) if len(value) == 2 else number(*value) for value in values]


def _pair(ratio: float | None, correlation: float | None) -> str:
    """A ratio and in brackets a correlation, which needs the same digits in every row."""
    if ratio is None:
        return DASH
    first, second = (DASH if each is None else f"{each:.2f}" for each in (ratio, correlation))
    return f"{first} ({second})"
