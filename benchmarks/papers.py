"""What the papers print, measured on sequences of validation: tables of docs/reports/2026-11_papers.md.

Run from the checkout with PYTHONPATH=. as

    OMP_NUM_THREADS=1 python benchmarks/papers.py DATA [--models physxnet pbns RUN ...] [--frames 60]

DATA: a folder of `uvcloth simulate`. It prints, for every garment and method, as predicted (without a
finish), means over the frames of all clips: distance of the vertices in mm, root of the mean squared distance
of vertices and of texels (PhysXNet's Figure 6), change of edges in mm, bend (1 - cosine), share of the
vertices in the body in percent, milliseconds of processor time a frame. Of a method that uses its past
garments also the distance in one step and in rollouts of 50 frames, finished (Motion-guided's Table 3).
"""

import os
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import torch
import tyro

from evaluate.actions import find_windows
from evaluate.body_scores import body_scores
from evaluate.case import Case, open_case
from evaluate.judge import rolled_out
from evaluate.maps import garment_map
from evaluate.metrics import map_mse, shape_scores
from evaluate.stability import stability_scores, uses_feedback
from uvcloth.bodies.body import load_body
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.methods.capabilities import before_finish
from uvcloth.methods.method import Method
from uvcloth.methods.registry import load_method
from uvcloth.process.command import run_command
from uvcloth.rollouts.rollout import prepare_rollout

MEASURES = ("vertex_mean_mm", "vertex_mse_mm2", "map_mse_mm2", "edge_mm", "bend_cos", "inside_percent", "ms")
FED_BACK = ("one_step_mm", "rollout_50_mm", "vertex_mean_mm_finished")
SQUARED = ("vertex_mse_mm2", "map_mse_mm2")
"""Measures whose root is printed."""


@dataclass(frozen=True)
class Papers:
    """Measure the methods of the papers on their measures."""

    data: tyro.conf.Positional[Path]
    """Folder of sequences."""
    models: tuple[str, ...] = ("lbs", "lbs_smooth", "physxnet", "motion_guided", "pbns", "deepsd")
    """Methods and runs."""
    garments: tuple[str, ...] = ("tops", "bottoms", "dress")
    """Garments of the sequences."""
    clips: tuple[str, ...] = ("11_01", "26_01", "31_01", "35_01")
    """Clips of the sequences: windows of validation."""
    frames: int | None = None
    """Frames of each window after its warm-up, None for all."""
    map_size: int = 64
    """Size of the maps."""

    def run(self) -> None:
        """Print the table. Raises InputError for a sequence that is not there."""
        torch.set_num_threads(1)
        torch.set_grad_enabled(False)
        body = load_body()
        methods = dict(variants(load_method(name, body) for name in self.models))
        print(f"load {os.getloadavg()[0]:.1f}; roots of {', '.join(SQUARED)}")
        for name in self.garments:
            garment = load_garment(name, body)
            outfit, texels = Outfit(body, (garment,)), {name: garment_map(garment, body, self.map_size)}
            windows = [w for w in find_windows(self.data, (), (name,), "validation") if w.clip in self.clips]
            cases = [open_case((window,), outfit, texels, self.frames) for window in windows]
            for method_name, method in methods.items():
                if not method.unsupported_reason(outfit):
                    print(
                        f"{name} {method_name} {', '.join(w.clip for w in windows)}: {line(method, cases)}",
                        flush=True,
                    )


def variants(methods: Iterable[Method]) -> Iterator[tuple[str, Method]]:
    """Yield methods by name, and each without the parts that only do what a finish does."""
    for method in methods:
        yield method.name, method
        bare = before_finish(method)
        if bare is not method:
            yield f"{method.name} without physics", bare


def line(method: Method, cases: list[Case]) -> str:
    """The measures of a method, means over all frames of the cases."""
    values: dict[str, list[torch.Tensor]] = defaultdict(list)
    for case in cases:
        for key, scores in measured(method, case).items():
            values[key].append(scores)
    means = {key: float(torch.cat(each).mean()) for key, each in values.items()}
    means |= {key: means[key] ** 0.5 for key in SQUARED if key in means}
    return ", ".join(f"{key} {means[key]:.4g}" for key in (*MEASURES, *FED_BACK) if key in means)


def measured(method: Method, case: Case) -> dict[str, torch.Tensor]:
    """Measures of a method on a case, over its frames or some of them."""
    (part,) = case.parts
    raw, _, times = rolled_out(case, prepare_rollout(method, case.outfit, clear=False))
    scores = {
        **shape_scores(raw, part.reference),
        **map_mse(raw, part.reference),
        **body_scores(case.dressed[part.name], raw, case.body_vertices),
        "ms": times["network_ms"],
    }
    cleared = prepare_rollout(method, case.outfit)
    if uses_feedback(cleared, case):
        scores |= stability_scores(cleared, case)[part.name]
        _, resolved, _ = rolled_out(case, cleared)
        finished = shape_scores(resolved, part.reference)["vertex_mean_mm"]
        scores["vertex_mean_mm_finished"] = finished
    return scores


if __name__ == "__main__":
    sys.exit(run_command("papers.py", lambda: tyro.cli(Papers).run()))
