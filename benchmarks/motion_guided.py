"""What a frame of Motion-guided costs, beside its plain twin and the cloth engine, in one run.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/motion_guided.py [--preset fast|paper] [--vertices 18000]

The weights are untrained and displace nothing: times do not depend on them. The plain twin builds a channel
per seed and axis, as published. The engine
simulates the same garment over the same clip. Every figure is per frame: milliseconds, and how many times the
method's whole frame (network, clearing and writing) it takes.
"""

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import torch
import tyro
from rich.console import Console
from rich.table import Table
from torch import Tensor, nn
from torch.nn import functional

from uvcloth.bodies.body import Body, load_body
from uvcloth.garments.attach import DIFFUSION, make_garment
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.joined import join
from uvcloth.garments.templates import fit_template, tailored
from uvcloth.methods.motion_guided.config import PRESETS
from uvcloth.methods.motion_guided.descriptor import TAPS, Forces, RelativePositions, SeedForces
from uvcloth.methods.motion_guided.method import MotionGuided
from uvcloth.motion.clip import Clip
from uvcloth.motion.lead_in import LeadIn
from uvcloth.motion.library import load_clip
from uvcloth.rollouts.rollout import rollout
from uvcloth.simulation.explicit import Explicit
from uvcloth.simulation.run import simulate
from uvcloth.wardrobe.tailor import tailor
from uvcloth.writers.writer import open_writer


@dataclass(frozen=True)
class MotionGuidedBenchmark:
    """Measure a preset on the dress."""

    preset: str = "fast"
    """fast or paper."""
    vertices: int | None = None
    """Tailor the dress with about so many vertices; without it the template."""
    clip: str = "walk"
    """A clip."""
    frames: int = 30
    """Frames of it."""
    twin: bool = True
    """Measure the plain twin."""
    engine: bool = True
    """Measure the cloth engine."""


class PlainPositions(nn.Module):
    """RelativePositions with a channel per seed and axis."""

    def __init__(self, layer: RelativePositions) -> None:
        super().__init__()
        self.layer = layer

    def forward(self, positions: Tensor, mask: Tensor, seeds: Tensor) -> Tensor:
        channels = (positions[:, None] - seeds[..., None, None]) * mask[:, :, None]
        kernel = self.layer.weight.flatten(1, 2).unflatten(-1, (TAPS, TAPS))
        return functional.conv2d(channels.flatten(1, 2), kernel, padding=TAPS // 2)


class PlainForces(nn.Module):
    """SeedForces with a channel per seed and axis."""

    def __init__(self, layer: SeedForces) -> None:
        super().__init__()
        self.layer = layer

    def forward(self, forces: Forces, normals: Tensor, pixels: Tensor, size: int) -> Tensor:
        pushes = forces.dense()[..., None] * normals[:, None]
        maps = pushes.new_zeros(len(pushes), size * size, *pushes.shape[2:]).index_copy(1, pixels, pushes)
        channels = maps.flatten(2).transpose(1, 2).unflatten(-1, (size, size))
        kernel = self.layer.weight.flatten(1, 2).unflatten(-1, (TAPS, TAPS))
        return functional.conv2d(channels, kernel, padding=TAPS // 2)


def method(preset: str, garment: Garment, twin: bool) -> MotionGuided:
    made = MotionGuided.untrained(replace(PRESETS[preset], garment=garment.name))
    last = [layer for layer in made.space.modules() if isinstance(layer, nn.Linear)][-1]
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    if twin:
        made.dynamics.forces = PlainForces(made.dynamics.forces)  # type: ignore[assignment]
        if isinstance(getattr(made.space, "first", None), RelativePositions):
            made.space.first = PlainPositions(made.space.first)  # type: ignore[arg-type]
    return made


def garment_of(body: Body, vertices: int | None) -> Garment:
    if vertices is None:
        return fit_template("dress", body)
    mesh = tailored(tailor("dress", body, vertices), body)
    return make_garment("retailored", mesh, body, DIFFUSION["dress"])


def stages(made: MotionGuided, garment: Garment, body: Body, clip: Clip) -> dict[str, float]:
    """Median milliseconds of every stage."""

    spent: dict[str, list[float]] = {"network": [], "clearing": [], "writing": []}
    with tempfile.TemporaryDirectory() as folder:
        meshes = [(garment.name, garment.mesh)]
        with open_writer(Path(folder) / "dress.glb", meshes, body, clip.fps) as writer:
            for frame in rollout(made, Outfit(body, (garment,)), clip.transforms(), clip.fps):
                spent["network"].append(frame.milliseconds["network"])
                spent["clearing"].append(frame.milliseconds["clearing"])
                begun = time.perf_counter()
                writer.add(frame.vertices, frame.transforms)
                spent["writing"].append(1e3 * (time.perf_counter() - begun))
            begun = time.perf_counter()
            writer.finish()
            rest = 1e3 * (time.perf_counter() - begun) / len(clip)
    return {stage: median(values[2:]) + rest * (stage == "writing") for stage, values in spent.items()}


def main(options: MotionGuidedBenchmark) -> None:
    body = load_body()
    clip = load_clip(options.clip, body).window(0, options.frames)
    garment = garment_of(body, options.vertices)
    ours = stages(method(options.preset, garment, twin=False), garment, body, clip)
    whole = sum(ours.values())
    table = Table("per frame", "ms", "x the whole")
    rows = [*ours.items(), ("whole frame", whole)]
    if options.twin:
        twin = stages(method(options.preset, garment, twin=True), garment, body, clip.window(0, 5))["network"]
        rows.append(("plain twin's network", twin))
    if options.engine:
        parts = LeadIn(rest=1, blend=8, ramp=4)
        made = simulate(clip.window(0, 10), 0, (join(garment, body),), body, Explicit(), parts)
        rows.append(("cloth engine", 1e3 * made.metadata["wall_seconds"] / len(made.transforms)))
    for name, spent in rows:
        table.add_row(name, f"{spent:.1f}", f"{spent / whole:.2f}")
    console = Console()
    console.print(f"{options.preset}, dress of {len(garment.mesh.vertices)} vertices, {options.clip}")
    console.print(f"{torch.get_num_threads()} threads")
    console.print(table)


if __name__ == "__main__":
    main(tyro.cli(MotionGuidedBenchmark))
