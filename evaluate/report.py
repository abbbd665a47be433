"""One self-contained HTML page: figures, tables, pictures and a viewer, without a network."""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from torch import Tensor

from uvcloth.bodies.stream import BATCH
from uvcloth.files.atomic import atomic_write

from .answers import answers
from .candidates import SIMULATION
from .charts import DASH, bars, lines, mark, number, scatter
from .continuity import TURNED_FRAMES
from .cost_figures import cost_charts, small_multiples
from .familiar import cautions
from .force_balance import BALANCED_FRAMES, MOST_FORCE
from .intervals import LEAST_CLIPS, Interval, pooled
from .look_table import impossible_frames, look_table
from .memory import MEMORY_FRAMES
from .metrics import SAMPLED_FRAMES
from .pixels import DEPTH, PIXEL, VIEWED_FRAMES
from .results import LONG
from .stability import SHORT_ROLLOUT
from .standings import (
    OUTFIT,
    STAGES,
    Results,
    Standing,
    actions_in,
    clips_of,
    garments_in,
    methods_on,
    outfit_rows,
    overall,
    standings,
)
from .viewer import ViewerClip, pack_body, pack_clip
from .wrinkles import WRINKLED_FRAMES

TEMPLATES = Path(__file__).with_name("templates")
THREE = Path(str(files("uvcloth") / "data" / "page" / "three.min.js"))
METRICS = "metrics.json"
REPORT = "report.html"

MEASURES = {
    "vertex_mean_mm_raw": ("Mean vertex distance before the finish", "mm", "mm"),
    "vertex_rmse_mm_raw": ("Vertex RMSE before the finish", "mm", "rmse_mm"),
    "vertex_mse_mm2_raw": ("Vertex MSE before the finish", "mm²", "mse_mm2"),
    "map_mse_mm2": ("Map MSE before the finish", "mm²", ""),
    "vertex_mean_mm": ("Mean vertex distance after the finish", "mm", "mm"),
    "vertex_rmse_mm": ("Vertex RMSE after the finish", "mm", "rmse_mm"),
    "vertex_mse_mm2": ("Vertex MSE after the finish", "mm²", "mse_mm2"),
}
"""Charts after Figure 6 of PhysXNet, by measure: title, unit, and the suffix of the floors in them."""

PHYSICS = {
    "edge_mm": "Edge change (mm)",
    "bend_cos": "Bend (cosine distance)",
    "bend_rad": "Bend (rad)",
    "jitter_ratio": "Jitter ratio",
    "inside_percent": "Vertices inside (%)",
    "squeezed_percent": "Vertices squeezed (%)",
    "inside_faces_percent": "Cloth inside (% of area)",
    "skin_percent": "Skin that shows (% of covered)",
    "crossing_edges_percent": "Edges through cloth (%)",
    "skin_pixels_percent": "Skin in pictures (% of pixels)",
    "cloth_pixels_percent": "Cloth through cloth in pictures (% of pixels)",
}

SWING = {
    "swing_ratio": "Swing ÷ simulation's",
    "swing_correlation": "Correlation of swing",
    "nearest_member_mm": "Closest member (mm)",
    "ensemble_mm": "All members (mm)",
    "spread_ratio": "Spread ratio",
}
"""Motion of the cloth relative to the skinned garment, and distances from an ensemble: titles by field."""

PAPER_COSTS = (
    ("LBS", "1 MB", DASH, "3 ms"),
    ("TailorNet, shirt", "13.5 GB", "2.5 GB", "1 s"),
    ("TailorNet, pants", "3.4 GB", "1.2 GB", "500 ms"),
    ("PhysXNet", "1 MB", "1 GB", "30 ms"),
)
"""Table 1 as printed in the PhysXNet paper, on its authors' machine (a GTX 1080)."""


@dataclass(frozen=True)
class Picture:
    """A rendered picture: PNG bytes, a caption of one line, and the labels of its columns."""

    caption: str
    png: bytes
    labels: tuple[str, ...] = ()

    @property
    def base64(self) -> str:
        """The PNG for a data URL."""
        return base64.b64encode(self.png).decode("ascii")


@dataclass(frozen=True)
class MotionMap:
    """Frames laid out in the plane so that similar poses lie together.

    methods: those trained on the same `of` sequences, of which the data folder contains `count`. seeds:
    number of body points that describe a pose. training: (P, 2) frames of these sequences, in the unit
    square. tests: by action, (P, 2) judged frames, at the same places on every map.
    """

    methods: tuple[str, ...]
    of: int
    count: int
    seeds: int
    training: Tensor
    tests: Mapping[str, Tensor]


def write_metrics(out: Path, results: Results) -> Path:
    """Write OUT/metrics.json, whole or not at all. Raises InputError if it cannot be written."""
    return _write(Path(out) / METRICS, json.dumps(results, indent=1))


def write_report(
    out: Path,
    results: Results,
    viewer_sequences: Sequence[ViewerClip],
    pictures: Sequence[Picture],
    spaces: Sequence[Picture] = (),
    motion: Sequence[MotionMap] = (),
) -> Path:
    """Write OUT/report.html from evaluation results and return its path.

    viewer_sequences: windows to scrub through. pictures: shown in order. spaces: interpolated garments.
    motion: training and test motion. Raises InputError if the folder cannot be written.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["figure"] = number
    bodies = list({id(clip.body): clip.body for clip in viewer_sequences}.values())
    packed = [
        pack_clip(clip, list(results["methods"]), next(i for i, b in enumerate(bodies) if b is clip.body))
        for clip in viewer_sequences
    ]
    rows = standings(results)
    chance, figures = _chance(rows)
    page = environment.get_template("report.html").render(
        results=results,
        methods=list(results["methods"]),
        answers=answers(results),
        cautions=cautions(results),
        static=[name for name, judged in results["methods"].items() if judged["static"]],
        garments=garments_in(results),
        judged={garment: methods_on(results, garment) for garment in garments_in(results)},
        trained=[name for name, judged in results["methods"].items() if judged["training"]],
        measures=MEASURES,
        physics={when: _filled(results, PHYSICS, suffix) for when, suffix in STAGES.items()},
        swing={when: _filled(results, SWING, suffix) for when, suffix in STAGES.items()},
        chance=chance,
        ranks={
            garment: [each for each in zip(rows, figures, strict=True) if each[0].garment == garment]
            for garment in (*garments_in(results), *results["outfits"])
        },
        feeds_back=_feeds_back(results),
        swing_figure=partial(_swing_figure, results),
        looks=look_table(results),
        impossible=impossible_frames(results),
        most_force=MOST_FORCE,
        turned=TURNED_FRAMES,
        balanced=BALANCED_FRAMES,
        viewed=VIEWED_FRAMES,
        sampled=SAMPLED_FRAMES,
        pixel_mm=1000 * PIXEL,
        depth_mm=1000 * DEPTH,
        wrinkled=WRINKLED_FRAMES,
        after_stops=_stop_charts(results),
        outfit_titles=OUTFIT,
        stages=STAGES,
        paper_costs=PAPER_COSTS,
        missing=[f"{a}, {t} ({why})" for a, by in results["missing"].items() for t, why in by.items()],
        least_clips=LEAST_CLIPS,
        outfit_rows=outfit_rows(results),
        charts=_bar_charts(results),
        costs=cost_charts(results),
        small_costs=small_multiples(results),
        energy_scores=_energy_scores(results),
        over_time=_time_charts(results),
        overall=overall,
        batch=BATCH,
        memory=any("memory_mb" in method for method in results["methods"].values()),
        memory_frames=MEMORY_FRAMES,
        alone=SHORT_ROLLOUT,
        long=LONG,
        viewer_headers=[header for header, _ in packed],
        viewer_blobs=[blob for _, blob in packed],
        viewer_bodies=[pack_body(body) for body in bodies],
        viewer_script=(TEMPLATES / "viewer.js").read_text(encoding="utf-8"),
        three=THREE.read_text(encoding="utf-8"),
        pictures=pictures,
        spaces=spaces,
        motion=[(each, _motion_chart(each)) for each in motion],
        mark=mark,
    )
    return _write(Path(out) / REPORT, page)


def _swing_figure(results: Results, name: str, garment: str, key: str, suffix: str) -> float | None:
    """A figure of the table of swing; the spread ratio is the one of the standings."""
    method = results["methods"][name]
    if key == "spread_ratio":
        return pooled(clips_of(method, garment), key, suffix)
    return overall(method["actions"], garment, key + suffix)


def _filled(results: Results, columns: Mapping[str, str], suffix: str) -> dict[str, str]:
    """The columns in which a method has a figure. suffix: of the fields."""
    cells = [
        cell
        for method in results["methods"].values()
        for by_garment in method["actions"].values()
        for cell in by_garment.values()
    ]
    return {
        key: title
        for key, title in columns.items()
        if any(cell.get(key + suffix) is not None for cell in cells)
    }


def _chance(rows: Sequence[Standing]) -> tuple[list[str], list[list[str]]]:
    """The titles of the columns on chance in which a method has a figure, and those figures of each row."""
    cells = [
        {
            "Spread ratio": number(row.spread_ratio),
            "Interval": _range(row.intervals["spread_ratio"]),
            "Mean (mm), interval": _range(row.intervals["vertex_mean_mm"]),
            "Above the row before": _range(row.above) if row.above is None or row.apart else "no difference",
        }
        for row in rows
    ]
    titles = [title for title in cells[0] if any(each[title] != DASH for each in cells)] if cells else []
    return titles, [[cell[title] for title in titles] for cell in cells]


def _feeds_back(results: Results) -> bool:
    """True where a method continues from observed garments, or drifts in a long window."""
    return any(
        cell["late_over_early"] is not None or cell["one_step_mm"] not in (None, cell["whole_mm"])
        for method in results["methods"].values()
        for cell in method["stability"].values()
    )


def _range(interval: Interval | None) -> str:
    """An interval in figures; a dash where there is none."""
    return DASH if interval is None else f"{number(interval[0])} … {number(interval[1])}"


def _bar_charts(results: Results) -> dict[str, list[Any]]:
    """A chart for each garment and measure."""
    names = list(results["methods"])
    charts: dict[str, list[Any]] = {}
    for key, (title, unit, suffix) in MEASURES.items():
        charts[key] = []
        for garment in garments_in(results):
            rows = {
                action: [
                    results["methods"][name]["actions"].get(action, {}).get(garment, {}).get(key)
                    for name in names
                ]
                for action in actions_in(results, garment)
            }
            floors = {
                kind: results["floor"][f"{kind}_{suffix}"][garment]
                for kind in ("representation", "repeatability")
                if suffix and results["floor"].get(f"{kind}_{suffix}", {}).get(garment) is not None
            }
            if any(value is not None for row in rows.values() for value in row):
                charts[key].append(bars(f"{garment}: {title.lower()}", rows, names, unit, floors))
    return charts


def _energy_scores(results: Results) -> list[str]:
    """The energy scores of methods of which several rollouts were judged, in words."""
    return [
        f"{garment}, {name}: {number(score)} mm"
        for garment in garments_in(results)
        for name in methods_on(results, garment)
        if (score := overall(results["methods"][name]["actions"], garment, "energy_score_mm")) is not None
    ]


def _time_charts(results: Results) -> dict[str, list[Any]]:
    """Before and after the finish, a chart per garment."""
    methods = results["methods"]
    charts: dict[str, list[Any]] = {when: [] for when in STAGES}
    for when, suffix in STAGES.items():
        for garment in garments_in(results):
            lasting = [methods[name].get(f"over_time_mm{suffix}", {}).get(garment, []) for name in methods]
            if any(lasting):
                title = f"{garment}, {when} the finish"
                charts[when].append(lines(title, lasting, list(methods), "mm", results["fps"]))
    return charts


def _stop_charts(results: Results) -> list[Any]:
    """Energy after a stop, a chart per garment of the windows that end in one."""
    methods, true = results["methods"], results[SIMULATION].get("stop_energy_mj_kg", {})
    return [
        lines(
            f"{garment}: energy after a stop",
            [method.get("stop_energy_mj_kg", {}).get(garment, []) for method in methods.values()],
            list(methods),
            "mJ/kg",
            results["fps"],
            true[garment],
        )
        for garment in garments_in(results)
        if true.get(garment)
    ]


def _motion_chart(motion: MotionMap) -> Any:
    """A scatter of training and judged frames."""
    groups = {"training": motion.training.tolist()}
    groups |= {action: places.tolist() for action, places in motion.tests.items()}
    return scatter("Training of " + ", ".join(motion.methods), groups)


def _write(path: Path, text: str) -> Path:
    """Write a text file, whole or not at all. Raises InputError if it cannot be written."""
    with atomic_write(path) as partial:
        partial.write_text(text, encoding="utf-8")
    return path
