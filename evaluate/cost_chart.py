"""Charts against cost: each method as a point, beside the floors of chance and of what can be represented."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup, escape

from .charts import open_chart, tick_label, ticks

WIDTH, LEFT, RIGHT, TOP = 560, 36, 340, 30
"""Width of the chart, and its plot; names of methods and floors are on its right."""

HEIGHT = 240
"""Least height of the plot: it grows with the number of names."""

SMALL_WIDTH, SMALL_HEIGHT, SMALL_LEFT = 190, 120, 26
"""Size of the plot of a small chart, without names, and the place of its left end."""

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
    """A method.

    index: of its style. value, raw: after and before the finish. ms, raw_ms: time of a frame with and without
    it, None if it was not timed. says: the value in words.
    """

    name: str
    index: int
    value: float
    raw: float
    ms: float | None
    raw_ms: float | None
    says: str


@dataclass(frozen=True)
class ReferenceLine:
    """A line at a value. style: of the line. says: its name and value in words."""

    value: float
    says: str
    style: str = "floor"


@dataclass(frozen=True)
class Axis:
    """Axis on which values low to high are at begin to end. logarithmic: or else linear."""

    low: float
    high: float
    begin: float
    end: float
    logarithmic: bool = True

    def at(self, value: float) -> float:
        """The place of a value; the end of the axis for one beyond it."""
        inside = min(max(value, self.low), self.high)
        share = (
            math.log(inside / self.low) / math.log(self.high / self.low)
            if self.logarithmic
            else (inside - self.low) / (self.high - self.low)
        )
        return self.begin + share * (self.end - self.begin)

    def ticks(self) -> list[float]:
        """Values 1, 2 and 5 times a power of ten, or the powers alone where those are too many.

        On a linear axis they are round values.
        """
        if not self.logarithmic:
            return ticks(self.high)
        powers = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        values = [minor * 10.0**power for power in powers for minor in MINOR]
        inside = [value for value in values if self.low <= value <= self.high]
        return (
            inside
            if len(inside) <= MOST_TICKS
            else [10.0**power for power in powers if 10.0**power in inside]
        )


@dataclass(frozen=True)
class Plot:
    """Both axes. untimed: whether there is a strip at its right end for methods without a time."""

    across: Axis
    up: Axis
    untimed: bool

    @classmethod
    def of(
        cls,
        points: Sequence[CostPoint],
        floors: Sequence[ReferenceLine],
        box: tuple[float, float, float, float],
        logarithmic: bool,
    ) -> "Plot":
        """A plot of points and lines. box: left, right, top and bottom. logarithmic: values, too."""
        left, right, top, bottom = box
        values = [value for point in points for value in (point.value, point.raw)]
        values += [floor.value for floor in floors]
        times = [time for point in points for time in (point.ms, point.raw_ms) if time]
        untimed = any(point.ms is None for point in points)
        up = (
            _log_axis([max(value, LEAST) for value in values], bottom, top)
            if logarithmic
            else Axis(0.0, ticks(max([*values, 0.1]) * ROOM)[-1], bottom, top, False)
        )
        strip = STRIP * (right - left) / (RIGHT - LEFT)
        return cls(_log_axis(times, left, right - strip if untimed else right), up, untimed)

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, right, top and bottom, the strip included."""
        left, right = self.across.begin, self.across.end
        width = (right - left) / (1.0 - STRIP / (RIGHT - LEFT)) if self.untimed else right - left
        return left, left + width, self.up.end, self.up.begin

    def place(self, value: float, ms: float | None) -> tuple[float, float]:
        """The place of a value with a time, or in the strip."""
        unknown = 0.5 * (self.across.end + self.box[1])
        return self.across.at(ms) if ms else unknown, self.up.at(value)

    def grid(self, unit: str) -> list[str]:
        """Lines and labels of both axes."""
        left, right, top, bottom = self.box
        parts = [
            f'<line class="grid" x1="{left}" x2="{right:.1f}" y1="{self.up.at(tick):.1f}" '
            f'y2="{self.up.at(tick):.1f}"/>'
            f'<text class="tick" x="{left - 6}" y="{self.up.at(tick) + 3:.1f}" text-anchor="end">'
            f"{tick_label(tick)}</text>"
            for tick in self.up.ticks()
        ]
        parts += [
            f'<line class="grid" x1="{self.across.at(tick):.1f}" x2="{self.across.at(tick):.1f}" y1="{top}" '
            f'y2="{bottom}"/>'
            f'<text class="tick" x="{self.across.at(tick):.1f}" y="{bottom + 14}" text-anchor="middle">'
            f"{tick_label(tick)}</text>"
            for tick in self.across.ticks()
        ]
        if self.untimed:
            edge = self.across.end
            parts.append(
                f'<line class="grid" x1="{edge:.1f}" x2="{edge:.1f}" y1="{top}" y2="{bottom}"/>'
                f'<text class="tick" x="{right:.1f}" y="{top - 4}" text-anchor="end">no time</text>'
            )
        return [*parts, f'<text class="unit" x="{left - 6}" y="{top - 6}">{escape(unit)}</text>']

    def line(self, floor: ReferenceLine) -> str:
        """A floor across the plot."""
        left, right, _, _ = self.box
        y = self.up.at(floor.value)
        return (
            f'<line class="{floor.style}" x1="{left}" x2="{right:.1f}" y1="{y:.1f}" y2="{y:.1f}">'
            f"<title>{escape(floor.says)}</title></line>"
        )

    def mark(self, point: CostPoint) -> str:
        """The disc of a method after the finish, joined to its ring before it."""
        (x, y), (before, ring) = self.place(point.value, point.ms), self.place(point.raw, point.raw_ms)
        return (
            f'<line class="join" x1="{before:.1f}" y1="{ring:.1f}" x2="{x:.1f}" y2="{y:.1f}"/>'
            f'<circle class="ring" cx="{before:.1f}" cy="{ring:.1f}" r="3.5"/>'
            f'<circle class="m{point.index}" cx="{x:.1f}" cy="{y:.1f}" r="4.5">'
            f"<title>{escape(point.name)}: {escape(point.says)}</title></circle>"
        )


def cost_chart(
    title: str, points: Sequence[CostPoint], floors: Sequence[ReferenceLine], unit: str, logarithmic: bool
) -> Markup:
    """Points of methods after the finish (discs) and before it (rings), joined; names and floors beside it.

    unit: of the values, whose axis is logarithmic or begins at 0.
    """
    bottom = TOP + max(HEIGHT, LINE * (len(points) + len(floors)))
    plot = Plot.of(points, floors, (LEFT, RIGHT, TOP, bottom), logarithmic)
    parts = [open_chart(WIDTH, bottom + 34, title, left=0), *plot.grid(unit), *map(plot.line, floors)]
    parts.append(f'<text class="unit" x="{RIGHT}" y="{bottom + 28}" text-anchor="end">ms a frame</text>')
    named = [(*plot.place(point.value, point.ms), f"{point.name} {point.says}") for point in points]
    named += [(float(RIGHT), plot.up.at(floor.value), floor.says) for floor in floors]
    named.sort(key=lambda name: name[1])
    for (x, y, says), row in zip(named, _spread([y for _, y, _ in named], bottom), strict=True):
        parts.append(
            f'<line class="leader" x1="{x:.1f}" y1="{y:.1f}" x2="{RIGHT + 8}" y2="{row:.1f}"/>'
            f'<text class="label" x="{RIGHT + 12}" y="{row + 3.5:.1f}">{escape(says)}</text>'
        )
    return Markup("".join([*parts, *map(plot.mark, points)]) + "</svg>")


def small_chart(
    title: str, points: Sequence[CostPoint], floors: Sequence[ReferenceLine], unit: str, logarithmic: bool
) -> Markup:
    """The same without names: each disc has the number of its method, its index + 1."""
    right, bottom = SMALL_LEFT + SMALL_WIDTH, TOP + SMALL_HEIGHT
    plot = Plot.of(points, floors, (SMALL_LEFT, right, TOP, bottom), logarithmic)
    parts = [open_chart(right + 12, bottom + 18, title, left=0), *plot.grid(unit), *map(plot.line, floors)]
    for point in points:
        x, y = plot.place(point.value, point.ms)
        number = f'<text class="value" x="{x + 6:.1f}" y="{y + 3:.1f}">{point.index + 1}</text>'
        parts += [plot.mark(point), number]
    return Markup("".join(parts) + "</svg>")


def _log_axis(values: Sequence[float], begin: float, end: float) -> Axis:
    """An axis over positive values, from tick to tick; 1 to 10 without any."""
    if not values:
        return Axis(1.0, 10.0, begin, end)
    low, high = min(values) / ROOM, max(values) * ROOM
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ends = [minor * 10.0**power for power in powers for minor in MINOR]
    return Axis(max(e for e in ends if e <= low), min(e for e in ends if e >= high), begin, end)


def _spread(heights: Sequence[float], bottom: float) -> list[float]:
    """Heights from the top down, at least LINE apart and, where there is room, above the end of the plot."""
    rows: list[float] = []
    for height in heights:
        rows.append(max(height, rows[-1] + LINE) if rows else height)
    # Names that went beyond the end push those above them up.
    limit = bottom
    for place in reversed(range(len(rows))):
        rows[place] = max(min(rows[place], limit), TOP + LINE * place)
        limit = rows[place] - LINE
    return rows
