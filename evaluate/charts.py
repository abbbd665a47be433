"""Bars and lines as inline SVG that takes its colours from the page, light or dark."""

import math
from collections.abc import Mapping, Sequence

from markupsafe import Markup, escape

LABEL = 96
ROW = 10
WIDTH = 370
DASH = "\u2013"

COLORS = 7
"""Colours of the page that stand out from its greys: --m1 ... --m7."""


def ticks(largest: float) -> list[float]:
    """About four round tick values 0 .. >= largest: steps of 1, 2, 2.5 or 5 times a power of ten."""
    if not largest > 0:
        return [0.0, 1.0]
    rough = largest / 4
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * m for m in (1, 2, 2.5, 5, 10) if power * m >= rough * 0.999)
    return [step * index for index in range(math.ceil(largest / step * 0.999) + 1)]


def number(value: float | None) -> str:
    """A figure with as many digits as a reader needs; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return DASH
    if value == 0:
        return "0"
    magnitude = abs(value)
    digits = 0 if magnitude >= 100 else 1 if magnitude >= 10 else 2 if magnitude >= 0.1 else 3
    return f"{value:,.{digits}f}"


def bars(
    title: str,
    rows: Mapping[str, Sequence[float | None]],
    names: Sequence[str],
    unit: str,
    floors: Mapping[str, float],
) -> Markup:
    """Grouped horizontal bars: for every row (an action) one bar per name (a method), in order.

    A name without any value gets no space in the chart.
    floors: vertical dashed lines by name, in the same unit.
    """
    values = [value for row in rows.values() for value in row if value is not None]
    axis = ticks(max([*values, *floors.values(), 0.0]))
    left, right, top = LABEL, WIDTH - 44, 26
    present = [
        method for method in range(len(names)) if any(row[method] is not None for row in rows.values())
    ]
    group = ROW * len(present) + 8
    height = top + group * len(rows) + 22

    def x(value: float) -> float:
        return left + (right - left) * value / axis[-1]

    parts = [open_chart(WIDTH, height, title, left=0)]
    for tick in axis:
        parts.append(
            f'<line class="grid" x1="{x(tick):.1f}" x2="{x(tick):.1f}" y1="{top - 4}" y2="{height - 20}"/>'
            f'<text class="tick" x="{x(tick):.1f}" y="{height - 7}" text-anchor="middle">'
            f"{tick_label(tick)}</text>"
        )
    for index, (label, row) in enumerate(rows.items()):
        y = top + index * group
        parts.append(
            f'<text class="label" x="{left - 8}" y="{y + group / 2:.1f}" text-anchor="end">'
            f"{escape(label)}</text>"
        )
        for place, method in enumerate(present):
            value = row[method]
            if value is None:
                continue
            bar = y + place * ROW
            parts.append(
                f'<rect class="m{method}" x="{left}" y="{bar}" width="{x(value) - left:.1f}" '
                f'height="{ROW - 1.5}"><title>{escape(label)}, {escape(names[method])}: {number(value)} '
                f'{escape(unit)}</title></rect><text class="value" x="{x(value) + 4:.1f}" '
                f'y="{bar + ROW - 2.5}">{number(value)}</text>'
            )
    for index, (name, value) in enumerate(floors.items()):
        parts.append(
            f'<line class="floor f{index}" x1="{x(value):.1f}" x2="{x(value):.1f}" y1="{top - 4}" '
            f'y2="{height - 20}"><title>{escape(name)}: {number(value)} {escape(unit)}</title></line>'
        )
    parts.append(
        f'<text class="unit" x="{right + 40}" y="{height - 7}" text-anchor="end">{escape(unit)}</text>'
    )
    return Markup("".join(parts) + "</svg>")


def lines(
    title: str,
    series: Sequence[Sequence[float]],
    names: Sequence[str],
    unit: str,
    fps: float,
    reference: Sequence[float] = (),
) -> Markup:
    """One line per name over time: series[i][t] at second t / fps, in `unit`; a dashed one of a reference."""
    longest = max([len(line) for line in (*series, reference)] + [2])
    across = ticks((longest - 1) / fps)
    up = ticks(max([value for line in (*series, reference) for value in line] + [0.0]))
    left, right, top, bottom = 40, WIDTH - 12, 26, 196

    def x(seconds: float) -> float:
        return left + (right - left) * seconds / across[-1]

    def y(value: float) -> float:
        return bottom - (bottom - top) * value / up[-1]

    parts = [open_chart(WIDTH, bottom + 26, title, left)]
    for tick in up:
        parts.append(
            f'<line class="grid" x1="{left}" x2="{right}" y1="{y(tick):.1f}" y2="{y(tick):.1f}"/>'
            f'<text class="tick" x="{left - 6}" y="{y(tick) + 3:.1f}" text-anchor="end">'
            f"{tick_label(tick)}</text>"
        )
    for tick in across:
        parts.append(
            f'<text class="tick" x="{x(tick):.1f}" y="{bottom + 14}" text-anchor="middle">'
            f"{tick_label(tick)}</text>"
        )
    styles = [f"l{index}" for index in range(len(series))]
    for style, name, line in zip(
        [*styles, "floor"], [*names, "simulation"], [*series, reference], strict=True
    ):
        points = " ".join(f"{x(t / fps):.1f},{y(value):.1f}" for t, value in enumerate(line))
        parts.append(f'<polyline class="{style}" points="{points}"><title>{escape(name)}</title></polyline>')
    parts.append(
        f'<text class="unit" x="{right}" y="13" text-anchor="end">{escape(unit)}</text>'
        f'<text class="unit" x="{right}" y="{bottom + 24}" text-anchor="end">seconds</text>'
    )
    return Markup("".join(parts) + "</svg>")


def scatter(title: str, groups: Mapping[str, Sequence[Sequence[float]]]) -> Markup:
    """Points (x, y) of each group in the unit square, without axes; the first group lies under the others."""
    top, margin = 22, 8
    side = WIDTH - 2 * margin
    bottom = top + side + 2 * margin
    parts = [
        open_chart(WIDTH, bottom + 1, title, left=0),
        f'<rect class="frame" x="0.5" y="{top}" width="{WIDTH - 1}" height="{bottom - top}"/>',
    ]
    for index, (name, group) in enumerate(groups.items()):
        dots = "".join(f"M{margin + side * x:.1f} {bottom - margin - side * y:.1f}h0" for x, y in group)
        parts.append(f'<path class="dots {mark(index)}" d="{dots}"><title>{escape(name)}</title></path>')
    return Markup("".join(parts) + "</svg>")


def mark(index: int) -> str:
    """The style of group `index` of a scatter: soft discs first, then discs and squares in the colours."""
    if index == 0:
        return "p0"
    lap, color = divmod(index - 1, COLORS)
    return f"p{color + 1}" + (" square" if lap % 2 else "")


def open_chart(width: float, height: float, title: str, left: float) -> str:
    """The beginning of an SVG chart with its title."""
    return (
        f'<svg class="chart" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title)}">'
        f'<text class="title" x="{left}" y="13">{escape(title)}</text>'
    )


def tick_label(value: float) -> str:
    """The label of a tick."""
    return f"{value:,.10g}"
