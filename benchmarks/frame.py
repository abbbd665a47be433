"""The cost of a dressed frame, stage by stage and outfit by outfit, from the motion to the fine vertices.

Run from the checkout with PYTHONPATH=. as

    OMP_NUM_THREADS=1 python benchmarks/frame.py [--models physics@fast physics] [--layers 2 5 10 20]

Every figure is processor time on one thread, in milliseconds per frame: the median of several rollouts of the
mean over their frames, so that other programs on the machine count little; its load is printed beside it.
Cages, kernels and the first frame do not count. With --layers it wears so many skirts over each other, 4 mm
apart, instead of outfits.
"""

import os
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
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
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.loading import load_outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.methods.method import Method
from uvcloth.methods.physics.finish import Finished
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.methods.registry import load_method
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import load_clip
from uvcloth.process.command import run_command
from uvcloth.rollouts.rollout import rollout

STAGES = {
    "body": "uvcloth.bodies.stream:body_frames",
    "runtime": "uvcloth.player.outfit:Cloth.step",
    "network": "uvcloth.methods.physxnet.network:GarmentNet.forward",
}
"""Stages and their functions; all else is in the row of that name."""

OUTFITS = (("dress",), ("bottoms", "tops"), ("bottoms", "shirt", "jacket"))
"""Outfits, the innermost garment first."""

SPACING = 0.004
"""Metres between layers."""

WIDTH = 160
"""Characters that the table needs, at most."""


@dataclass(frozen=True)
class DressedFrames:
    """Measure dressed frames."""

    models: tuple[str, ...] = ("physics@fast", "physics", "physics@fine", "physxnet", "physxnet@dynamic")
    """Models; after @ a quality of physics, or `dynamic` for a network's finish."""
    clip: str = "walk"
    """A clip."""
    frames: int = 60
    """Frames of it."""
    rounds: int = 3
    """Rollouts of each; the median counts."""
    layers: tuple[int, ...] = ()
    """Numbers of skirts over each other."""

    def run(self) -> None:
        """Print the table. Raises InputError for a model that is not there."""
        torch.set_num_threads(1)
        torch.set_grad_enabled(False)
        body = load_body()
        clip = load_clip(self.clip, body).window(0, self.frames)
        outfits = {f"{count} skirts": _skirts(count, body) for count in self.layers} or {
            ", ".join(names): load_outfit(names, body) for names in OUTFITS
        }
        table = Table("ms a frame, one thread", *STAGES, "all else", "whole frame")
        for model in self.models:
            method = _method(model, body)
            for name, garments in outfits.items():
                outfit = Outfit(body, garments)
                if not method.unsupported_reason(outfit):
                    rounds = [_measured(method, outfit, clip) for _ in range(self.rounds)]
                    spent = [median(each[stage] for each in rounds) for stage in rounds[0]]
                    table.add_row(f"{model}: {name}", *(f"{each:.2f}" for each in spent))
        console = Console(width=max(Console().width, WIDTH))
        console.print(table)
        load = ", ".join(f"{each:.1f}" for each in os.getloadavg())
        console.print(
            f"{clip.name}, {len(clip)} frames, load of the machine {load} on {os.cpu_count()} cores"
        )


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
def clocked() -> Iterator[Clock]:
    """A clock on the functions of STAGES."""
    clock = Clock()
    with ExitStack() as stack:
        for stage, place in STAGES.items():
            owner, _, name = place.replace(":", ".").rpartition(".")
            run = clock.timed(stage, resolve_name(place))
            stack.enter_context(patch.object(resolve_name(owner), name, run))
        yield clock


def _measured(method: Method, outfit: Outfit, clip: Clip) -> dict[str, float]:
    """Milliseconds of each stage of a frame, of all else and of the whole."""
    with clocked() as clock:
        frames = rollout(method, outfit, clip.transforms(torch.float64), clip.fps)
        next(frames)
        # The body is posed for several frames at once, before the first of them.
        posing = clock.spent["body"]
        clock.spent.clear()
        begun = time.thread_time()
        counted = sum(1 for _ in frames)
        whole = time.thread_time() - begun + posing
    spent = {stage: clock.spent[stage] for stage in STAGES}
    spent["body"] += posing
    spent |= {"all else": whole - sum(spent.values()), "whole frame": whole}
    return {stage: 1e3 * seconds / counted for stage, seconds in spent.items()}


def _method(model: str, body: Body) -> Method:
    name, _, variant = model.partition("@")
    if name == "physics":
        return Physics(PhysicsConfig(variant or "default"))
    if variant not in ("", "dynamic"):
        raise InputError(f"--models {model}: expected {name} or {name}@dynamic")
    method = load_method(name, body)
    return Finished.of(method, Physics(PhysicsConfig())) if variant else method


def _skirts(count: int, body: Body) -> tuple[Garment, ...]:
    """Skirts over each other, the innermost first."""
    skirt = fit_template("skirt", body)
    normals = vertex_normals(skirt.mesh.vertices, skirt.mesh.faces)
    return tuple(
        replace(skirt, mesh=replace(skirt.mesh, vertices=skirt.mesh.vertices + SPACING * layer * normals))
        for layer in range(count)
    )


if __name__ == "__main__":
    sys.exit(run_command("frame.py", lambda: tyro.cli(DressedFrames).run()))
