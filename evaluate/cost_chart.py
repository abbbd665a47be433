"""Error against cost: each method as a point, on logarithmic axes, beside the floor of chance."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup, escape

from .charts import number, open_chart, tick_label
from .standings import Results, cells, garments_in, mean_of, methods_on

WIDTH, BOTTOM, LEFT, RIGHT, TOP = 560, 270, 36, 340, 30
"""Size of the chart and of its plot; names of methods are on its right."""

STRIP = 56
"""Width of the part of the plot that has the methods without a time."""

LINE = 12.0
"""Least distance between two names."""

ROOM = 1.05
"""Least factor between the outermost points and the ends of an axis."""

LEAST = 1.0
"""Error in mm below which a method is at the end of the axis: a simulation brought back has none."""

MINOR, MOST_TICKS = (1, 2, 5), 8
"""Ticks in each power of ten, and the most of an axis that has them."""


@dataclass(frozen=True)
class CostPoint:
    """A method on a garment, over all actions.

    index: of its style. error, raw: mean vertex distance after and before the finish, mm. ms, raw_ms: time of
    a frame with and without it, None if it was not timed.
    """

    name: str
    index: int
    error: float
    raw: float
    ms: float | None
    raw_ms: float | None


@dataclass(frozen=True)
class LogAxis:
    """Logarithmic axis: values low to high are at begin to end."""

    low: float
    high: float
    begin: float
    end: float

    def at(self, value: float) -> float:
        """The place of a value; the end of the axis for one beyond it."""
        inside = min(max(value, self.low), self.high)
        share = math.log(inside / self.low) / math.log(self.high / self.low)
        return self.begin + share * (self.end - self.begin)

    def ticks(self) -> list[float]:
        """Values 1, 2 and 5 times a power of ten on the axis; the powers alone where those are too many."""
        powers = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        values = [minor * 10.0**power for power in powers for minor in MINOR]
        inside = [value for value in values if self.low <= value <= self.high]
        return (
            inside
            if len(inside) <= MOST_TICKS
            else [10.0**power for power in powers if 10.0**power in inside]
        )


def cost_charts(results: Results) -> list[Markup]:
    """A chart for each garment and outfit on which a method was timed."""
    floors = results["floor"].get("repeatability_mm", {})
    charts = []
    for garment in (*garments_in(results), *results["outfits"]):
        points = cost_points(results, garment)
        if any(point.ms for point in points):
            charts.append(cost_chart(f"{garment}: error and time per frame", points, floors.get(garment)))
    return charts


def cost_points(results: Results, garment: str) -> list[CostPoint]:
    """The methods that were judged on a garment or an outfit."""
    order = list(results["methods"])
    points = []
    for name in methods_on(results, garment):
        judged = list(cells(results["methods"][name], garment).values())
        error, raw = mean_of(judged, "vertex_mean_mm"), mean_of(judged, "vertex_mean_mm_raw")
        ms, raw_ms = mean_of(judged, "ms_per_frame"), mean_of(judged, "network_ms")
        if error is not None and raw is not None:
            points.append(CostPoint(name, order.index(name), error, raw, ms, raw_ms))
    return points


def cost_chart(title: str, points: Sequence[CostPoint], floor: float | None) -> Markup:
    """Points of methods after the finish (discs) and before it (rings), joined, with their names.

    floor: mean distance between two simulations, mm, a dashed line.
    """
    errors = [max(error, LEAST) for point in points for error in (point.error, point.raw)]
    times = [time for point in points for time in (point.ms, point.raw_ms) if time]
    untimed = any(point.ms is None for point in points)
    up = _axis([*errors, *([floor] if floor else [])], BOTTOM, TOP)
    across = _axis(times, LEFT, RIGHT - STRIP if untimed else RIGHT)
    parts = [open_chart(WIDTH, BOTTOM + 34, title, left=0), *_grid(across, up)]
    if untimed:
        parts.append(
            f'<line class="grid" x1="{across.end}" x2="{across.end}" y1="{TOP}" y2="{BOTTOM}"/>'
            f'<text class="tick" x="{RIGHT}" y="{BOTTOM + 14}" text-anchor="end">'
            "no time</text>"
        )
    if floor:
        y = up.at(floor)
        parts.append(
            f'<line class="floor" x1="{LEFT}" x2="{RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text class="label" x="{LEFT + 4}" y="{y - 4:.1f}">another simulation {number(floor)} mm</text>'
        )
    ranked = sorted(points, key=lambda point: -point.error)
    rows = _spread([up.at(point.error) for point in ranked])
    for point, row in zip(ranked, rows, strict=True):
        parts.append(_mark(point, across, up, row))
    return Markup("".join(parts) + "</svg>")


def _axis(values: Sequence[float], begin: float, end: float) -> LogAxis:
    """An axis over positive values, from tick to tick; 1 to 10 without any."""
    if not values:
        return LogAxis(1.0, 10.0, begin, end)
    low, high = min(values) / ROOM, max(values) * ROOM
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ends = [minor * 10.0**power for power in powers for minor in MINOR]
    return LogAxis(max(e for e in ends if e <= low), min(e for e in ends if e >= high), begin, end)


def _grid(across: LogAxis, up: LogAxis) -> list[str]:
    parts = [
        f'<line class="grid" x1="{LEFT}" x2="{RIGHT}" y1="{up.at(tick):.1f}" y2="{up.at(tick):.1f}"/>'
        f'<text class="tick" x="{LEFT - 6}" y="{up.at(tick) + 3:.1f}" text-anchor="end">'
        f"{tick_label(tick)}</text>"
        for tick in up.ticks()
    ]
    parts += [
        f'<line class="grid" x1="{across.at(tick):.1f}" x2="{across.at(tick):.1f}" y1="{TOP}" y2="{BOTTOM}"/>'
        f'<text class="tick" x="{across.at(tick):.1f}" y="{BOTTOM + 14}" text-anchor="middle">'
        f"{tick_label(tick)}</text>"
        for tick in across.ticks()
    ]
    return [
        *parts,
        f'<text class="unit" x="{LEFT - 6}" y="{TOP - 6}">mm</text>',
        f'<text class="unit" x="{RIGHT}" y="{BOTTOM + 28}" text-anchor="end">ms a frame</text>',
    ]


def _mark(point: CostPoint, across: LogAxis, up: LogAxis, row: float) -> str:
    """Disc, ring and name of a method. row: height of the name."""
    unknown = RIGHT - STRIP / 2
    x, y = across.at(point.ms) if point.ms else unknown, up.at(point.error)
    before, ring = across.at(point.raw_ms) if point.raw_ms else unknown, up.at(point.raw)
    spent = f", {number(point.ms)} ms" if point.ms else ""
    style = f"m{point.index}"
    return (
        f'<line class="join" x1="{before:.1f}" y1="{ring:.1f}" x2="{x:.1f}" y2="{y:.1f}"/>'
        f'<line class="leader" x1="{x:.1f}" y1="{y:.1f}" x2="{RIGHT + 8}" y2="{row:.1f}"/>'
        f'<circle class="ring" cx="{before:.1f}" cy="{ring:.1f}" r="3.5"/>'
        f'<circle class="{style}" cx="{x:.1f}" cy="{y:.1f}" r="4.5">'
        f"<title>{escape(point.name)}: {number(point.error)} mm{spent}</title></circle>"
        f'<text class="label" x="{RIGHT + 12}" y="{row + 3.5:.1f}">{escape(point.name)} '
        f"{number(point.error)} mm{spent}</text>"
    )


def _spread(heights: Sequence[float]) -> list[float]:
    """Heights from the top down, at least LINE apart and, where there is room, above the end of the plot."""
    rows: list[float] = []
    for height in heights:
        rows.append(max(height, rows[-1] + LINE) if rows else height)
    # Names that went beyond the end push those above them up.
    limit = float(BOTTOM)
    for place in reversed(range(len(rows))):
        rows[place] = max(min(rows[place], limit), TOP + LINE * place)
        limit = rows[place] - LINE
    return rows
