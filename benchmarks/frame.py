"""The cost of a dressed frame, stage by stage and method by method, beside the cloth engine in the same run.

Run from the checkout with PYTHONPATH=. as

    OMP_NUM_THREADS=1 python benchmarks/frame.py [--clip walk] [--engine]

Every figure is processor time on one thread, in milliseconds per frame: the median of several rollouts of the
mean over their frames, so that other programs on the machine count little; its load is printed beside it. The
engine's is the processor time of its whole process over the frames that it simulates, the way there included.
"""

import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import wraps
from pkgutil import resolve_name
from statistics import median
from typing import Any
from unittest.mock import patch

import torch
import tyro
from rich.console import Console
from rich.table import Table

from uvcloth.bodies.body import Body, load_body
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.registry import load_method
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import load_clip
from uvcloth.rollout import rollout

SHARED = {
    "body: posing": "uvcloth.rollout:body_frames",
    "clearing: opened collider": "uvcloth.physics.outfit_clearing:OutfitClearing.collider",
    "clearing: all else": "uvcloth.physics.outfit_clearing:OutfitClearing.clear",
    "clearing: layers": "uvcloth.physics.layers:Layer.beside",
}
"""Stages of every rollout."""

METHOD = "method: all else"
"""What a method's step does beside the stages below."""

STAGES = {
    "physxnet": {
        METHOD: "uvcloth.methods.physxnet.method:PhysXNet.step",
        "method: motion maps": "uvcloth.methods.physxnet.method:PhysXNet._motion",
        "method: network": "uvcloth.methods.physxnet.network:GarmentNet.forward",
        "method: decoding": "uvcloth.methods.physxnet.method:garment_vertices",
    },
    "motion_guided": {
        METHOD: "uvcloth.methods.motion_guided.method:MotionGuided.step",
        "method: feeding back": "uvcloth.methods.motion_guided.method:MotionGuided.feed_back",
        "method: motion maps": "uvcloth.methods.motion_guided.dynamics_input:motion_of",
        "method: forces": "uvcloth.methods.motion_guided.dynamics_input:contact_forces",
        "method: forces' maps": "uvcloth.methods.motion_guided.descriptor:SeedForces.forward",
        "method: network": "uvcloth.methods.motion_guided.latent:Dynamics.forward",
        "method: decoding": "uvcloth.methods.motion_guided.dynamics_input:rest_shape",
    },
    "pbns": {
        METHOD: "uvcloth.methods.pbns.method:PBNS.step",
        "method: network": "uvcloth.methods.pbns.network:PBNSNetwork.deform",
    },
    "lbs_smooth": {METHOD: "uvcloth.methods.lbs:LinearBlendSkinning.step"},
}
"""Stages of each method: those after the first are parts of it or stand beside it."""

OUTFITS = {
    "physxnet": (("dress",), ("bottoms", "tops")),
    "motion_guided": (("dress",),),
    "pbns": (("bottoms", "tops"),),
    "lbs_smooth": (("dress",), ("bottoms", "tops")),
}
"""What each method is measured on, the innermost garment first."""

WIDTH = 130
"""Characters that the table needs, at most."""


@dataclass(frozen=True)
class Options:
    """Measure dressed frames."""

    methods: tuple[str, ...] = tuple(OUTFITS)
    """Methods to measure."""
    clip: str = "walk"
    """A clip."""
    frames: int = 60
    """Frames of it."""
    rounds: int = 3
    """Rollouts of each; the median counts."""
    engine: bool = False
    """Measure the cloth engine too, which takes minutes."""


class Clock:
    """Processor time of this thread by stage, seconds; a stage within another counts for itself alone."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = defaultdict(float)
        self._within: list[float] = []

    def timed(self, stage: str, run: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, whose time counts for a stage."""

        @wraps(run)
        def wrapped(*arguments: Any, **named: Any) -> Any:
            begun = time.thread_time()
            self._within.append(0.0)
            try:
                return run(*arguments, **named)
            finally:
                whole = time.thread_time() - begun
                self.spent[stage] += whole - self._within.pop()
                if self._within:
                    self._within[-1] += whole

        return wrapped


@contextmanager
def clocked(stages: dict[str, str]) -> Iterator[Clock]:
    """A clock on functions, each named as module:attribute."""
    clock = Clock()
    with ExitStack() as stack:
        for stage, place in stages.items():
            owner, _, name = place.replace(":", ".").rpartition(".")
            run = clock.timed(stage, resolve_name(place))
            stack.enter_context(patch.object(resolve_name(owner), name, run))
        yield clock


def measure(method: str, names: Sequence[str], body: Body, clip: Clip) -> dict[str, float]:
    """Milliseconds of each stage of a frame, and of the whole; the first frame does not count."""
    outfit = Outfit(body, tuple(fit_template(name, body) for name in names))
    with clocked(SHARED | STAGES[method]) as clock:
        frames = rollout(load_method(method, body), outfit, clip.transforms(), clip.fps)
        next(frames)
        posing = clock.spent["body: posing"]
        clock.spent.clear()
        begun = time.thread_time()
        counted = sum(1 for _ in frames)
        whole = time.thread_time() - begun
    # The body is posed for several frames at once, before the first of them.
    spent = {stage: clock.spent[stage] for stage in SHARED | STAGES[method]}
    spent["body: posing"] += posing
    spent["all else"] = whole + posing - sum(spent.values())
    spent["whole frame"] = whole + posing
    return {stage: 1e3 * seconds / counted for stage, seconds in spent.items()}


def engine(names: Sequence[str], body: Body, clip: Clip) -> float:
    """Milliseconds of a frame of the default cloth engine."""
    from uvcloth.garments.joined import join
    from uvcloth.motion.lead_in import LeadIn
    from uvcloth.simulate.newton import Newton
    from uvcloth.simulate.run import simulate

    cloth = tuple(join(fit_template(name, body), body) for name in names)
    lead_in = LeadIn(rest=1, blend=8, ramp=4)
    begun = time.process_time()
    made = simulate(clip.window(0, 10), 0, cloth, body, Newton(), lead_in)
    return 1e3 * (time.process_time() - begun) / len(made.transforms)


def main(options: Options) -> None:
    torch.set_num_threads(1)
    body = load_body()
    clip = load_clip(options.clip, body).window(0, options.frames)
    console = Console(width=max(Console().width, WIDTH))
    cases = [(method, names) for method in options.methods for names in OUTFITS[method]]
    results = []
    for method, names in cases:
        rounds = [measure(method, names, body, clip) for _ in range(options.rounds)]
        results.append({stage: median(each[stage] for each in rounds) for stage in rounds[0]})
    stages = list(dict.fromkeys(stage for result in results for stage in result))
    last = ["all else", "whole frame"]
    table = Table("ms a frame, one thread")
    for method, names in cases:
        table.add_column(f"{method}\n{', '.join(names)}", justify="right")
    for stage in sorted(stages, key=lambda stage: (stage in last, stage)):
        table.add_row(stage, *(f"{result[stage]:.2f}" if stage in result else "" for result in results))
    if options.engine:
        costs = {names: engine(names, body, clip) for names in {names for _, names in cases}}
        table.add_row("cloth engine", *(f"{costs[names]:.0f}" for _, names in cases))
    console.print(table)
    load = ", ".join(f"{each:.1f}" for each in os.getloadavg())
    console.print(f"{clip.name}, {len(clip)} frames, load of the machine {load} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main(tyro.cli(Options))
