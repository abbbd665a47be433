"""The charts against cost of a report: error and swing, by garment, and by action and garment."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from .candidates import SIMULATION
from .charts import number
from .cost_chart import CostPoint, ReferenceLine, cost_chart, small_chart
from .judge import MEMBER_SUFFIX
from .standings import Results, actions_in, cells, garments_in, mean_of, methods_on

Cells = Sequence[Mapping[str, Any]]
"""The scores of some actions."""


@dataclass(frozen=True)
class Measure:
    """A figure that is drawn against time.

    title, unit: in words. key: of metrics.json. beside: of a second figure that stands in brackets.
    represented: of a method's representation.
    """

    title: str
    unit: str
    key: str
    represented: str
    beside: str = ""

    @property
    def logarithmic(self) -> bool:
        """True for errors, of which none is 0."""
        return self.unit == "mm"

    def says(self, value: float, beside: float | None = None) -> str:
        """A value in words."""
        return (
            f"{value:.2f}" + (f" ({beside:.2f})" if beside is not None else "")
            if self.beside
            else (f"{number(value)} {self.unit}")
        )


MEASURES = (
    Measure("error", "mm", "vertex_mean_mm", "mm"),
    Measure("swing", "÷ simulation's", "swing_ratio", "swing_ratio", "swing_correlation"),
)


def cost_charts(results: Results) -> list[Markup]:
    """Error and swing against time, for each garment and outfit on which a method was timed."""
    charts = []
    for garment in (*garments_in(results), *results["outfits"]):
        judged = {
            name: list(cells(results["methods"][name], garment).values())
            for name in methods_on(results, garment)
        }
        for measure in MEASURES:
            points = _points(results, judged, measure)
            if any(point.ms for point in points):
                floors = [
                    *_floors(results, garment, judged, measure),
                    *_represented(results, garment, measure),
                ]
                title = f"{garment}: {measure.title} and time per frame"
                charts.append(cost_chart(title, points, floors, measure.unit, measure.logarithmic))
    return charts


def small_multiples(results: Results) -> dict[str, list[Markup]]:
    """For each garment a small chart of each action and measure, where several actions were judged."""
    charts: dict[str, list[Markup]] = {}
    for garment in garments_in(results):
        actions = actions_in(results, garment)
        for action in actions if len(actions) > 1 else ():
            judged = {
                name: [by[action]]
                for name in methods_on(results, garment)
                if action in (by := cells(results["methods"][name], garment))
            }
            for measure in MEASURES:
                points = _points(results, judged, measure)
                if any(point.ms for point in points):
                    floors = _floors(results, garment, judged, measure, action)
                    charts.setdefault(garment, []).append(
                        small_chart(
                            f"{action}: {measure.title}", points, floors, measure.unit, measure.logarithmic
                        )
                    )
    return charts


def _points(results: Results, judged: Mapping[str, Cells], measure: Measure) -> list[CostPoint]:
    """The methods that have a figure."""
    order = list(results["methods"])
    points = []
    for name, each in judged.items():
        value, raw = mean_of(each, measure.key), mean_of(each, f"{measure.key}_raw")
        ms, raw_ms = mean_of(each, "ms_per_frame"), mean_of(each, "network_ms")
        if value is not None and raw is not None:
            says = measure.says(value, mean_of(each, measure.beside) if measure.beside else None)
            spent = f", {number(ms)} ms" if ms else ""
            points.append(CostPoint(name, order.index(name), value, raw, ms, raw_ms, says + spent))
    return points


def _floors(
    results: Results, garment: str, judged: Mapping[str, Cells], measure: Measure, action: str = ""
) -> list[ReferenceLine]:
    """Another simulation of the same ensemble, and for ratios the simulation itself. action: "" for all."""
    if measure.logarithmic:
        spread = _spread(judged) if action else results["floor"].get("repeatability_mm", {}).get(garment)
        return [ReferenceLine(spread, f"another simulation {measure.says(spread)}")] if spread else []
    true = [cell for each, cell in cells(results[SIMULATION], garment).items() if action in ("", each)]
    other, beside = (mean_of(true, f"{key}{MEMBER_SUFFIX}") for key in (measure.key, measure.beside))
    member = (
        [ReferenceLine(other, f"another simulation {measure.says(other, beside)}")]
        if other is not None
        else []
    )
    return [ReferenceLine(1.0, "the simulation 1", "level"), *member]


def _spread(judged: Mapping[str, Cells]) -> float | None:
    """Distance of the simulations of an action from each other, mm, the same for every method; or None."""
    having = (cell for each in judged.values() for cell in each if cell.get("spread_ratio"))
    return next((cell["ensemble_mm"] / cell["spread_ratio"] for cell in having), None)


def _represented(results: Results, garment: str, measure: Measure) -> list[ReferenceLine]:
    """The limit of each method's representation; methods that share it have one line."""
    names: dict[str, list[str]] = {}
    values: dict[str, float] = {}
    for name, method in results["methods"].items():
        figures = method["representation"].get(garment, {})
        value = figures.get(measure.represented)
        if value is not None:
            says = measure.says(value, figures.get(measure.beside))
            names.setdefault(says, []).append(name)
            values[says] = value
    return [
        ReferenceLine(values[says], f"limit of {_listed(each)} {says}", "floor f0")
        for says, each in names.items()
    ]


def _listed(names: Sequence[str]) -> str:
    """Names in words: the shortest, and the number of others."""
    others = len(names) - 1
    return min(names, key=len) + (f" and {others} more" if others else "")
