"""Draw error and swing against the time of a frame from a report, as the README shows them.

    PYTHONPATH=. python benchmarks/cost_picture.py REPORT/metrics.json GARMENT docs/cost.svg

A disc is a method after the finish, the ring joined to it before.
"""

import json
import re
import sys
from pathlib import Path

from evaluate.cost_figures import MEASURES, cost_charts
from evaluate.report import TEMPLATES
from uvcloth.files.atomic import atomic_write

MARGIN = 16.0
"""Space around each chart."""


def main(metrics: Path, garment: str, out: Path) -> None:
    """Write the charts of a garment above each other as one SVG, in the colours of the report by day."""
    charts = cost_charts(json.loads(metrics.read_text(encoding="utf-8")))
    mine = [str(chart) for chart in charts if f'aria-label="{garment}: ' in chart]
    sizes = [tuple(map(float, re.findall(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', each)[0])) for each in mine]
    assert len(mine) == len(MEASURES), f"{metrics}: has no charts of {garment}"
    width, height = max(size[0] for size in sizes) + 2 * MARGIN, sum(size[1] + MARGIN for size in sizes)
    # Without the colours of the night: a picture in a page does not know the page's own.
    style = re.sub(r"@media[^{]*\{\s*:root[^}]*\}\s*\}", "", (TEMPLATES / "report.css").read_text("utf-8"))
    rules = [line for line in style.splitlines() if line.startswith((":root", "  --", ".chart", ".m", "}"))]
    placed, top = [], MARGIN / 2
    for chart, (wide, tall) in zip(mine, sizes, strict=True):
        place = f'<svg x="{MARGIN}" y="{top}" width="{wide}" height="{tall}" overflow="visible" '
        placed.append(chart.replace("<svg ", place, 1))
        top += tall + MARGIN
    with atomic_write(out) as partial:
        partial.write_text(
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}">'
            f"<style>{' '.join(rules)}</style>"
            f'<rect width="{width}" height="{height}" fill="#fff"/>{"".join(placed)}</svg>\n',
            encoding="utf-8",
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]))
