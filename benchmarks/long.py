"""A hundred thousand frames: whether memory, time and garments stay as they are at the beginning.

Run from the checkout with PYTHONPATH=. as

    OMP_NUM_THREADS=1 python benchmarks/long.py [--frames 9000] [--models pbns] [--no-clear] [--no-writing]

Each method moves a dress (PBNS its shirt and trousers) over a walk that is played to and fro for as long as
it takes, while the body drifts off at 1 m/s: 100,000 frames lead 3.3 km away. Every frame goes to a PC2 and
a USD file. Every 1,000 frames it reads the memory of the process that is not shared with files (Linux), and
takes the processor time. Drift: the garment seen from the body's root in the last 1,000 frames against the
same poses among the first 1,000, mean over all vertices; beside it the same of the second 1,000. The first
repeat of the walk, in which the garments swing into it, does not count.
"""

import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import torch
import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table
from torch import Tensor

from evaluate.memory import process_megabytes
from uvcloth.bodies.body import Body, load_body
from uvcloth.export.writer import open_writer
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.registry import load_method
from uvcloth.motion.library import load_clip
from uvcloth.rollout import RolloutFrame, prepare_rollout

MODELS = ("lbs_smooth", "physxnet", "motion_guided", "pbns", "deepsd")
SPAN = 1000
"""Frames between two measurements."""

SPEED = 1.0
"""Metres per second at which the body drifts off."""

STRIDE = 10
"""Every so-many-th frame is kept to be compared."""


@dataclass
class Course:
    """Measurements of a rollout, for each SPAN of frames: memory, MB, and processor time per frame, ms.

    kept: garments seen from the root, (N, 3) m, by phase of the motion, of the first SPAN of frames. apart:
    of each SPAN, the mean distance from them, mm.
    """

    period: int
    memory: list[float] = field(default_factory=list)
    milliseconds: list[float] = field(default_factory=list)
    apart: list[float] = field(default_factory=list)
    difficult: int = 0
    kept: dict[int, Tensor] = field(default_factory=dict)
    sums: list[float] = field(default_factory=list)
    begun: float = 0.0

    def add(self, frame: RolloutFrame, root: Tensor) -> None:
        """Add the next frame; root: (3,) float64 m, world."""
        counted = frame.index - self.period
        self.difficult += bool(frame.difficulties)
        if counted < 0:
            self.begun = time.process_time()
            return
        phase = counted % self.period
        if counted % STRIDE == 0 and (counted < SPAN or phase in self.kept):
            garment = torch.cat(frame.vertices) + (frame.origin - root).float()
            if counted < SPAN and phase not in self.kept:
                self.kept[phase] = garment
            self.sums.append(1000.0 * float((garment - self.kept[phase]).norm(dim=1).mean()))
        if (counted + 1) % SPAN == 0:
            now = time.process_time()
            self.milliseconds.append(1000.0 * (now - self.begun) / SPAN)
            self.memory.append(anonymous_memory())
            self.apart.append(sum(self.sums) / max(len(self.sums), 1))
            Console().print(self.line(frame.index + 1))
            self.sums, self.begun = [], now

    def line(self, frames: int) -> str:
        """The last measurement, after so many frames, in words."""
        spent, memory, apart = self.milliseconds[-1], self.memory[-1], self.apart[-1]
        return f"{frames} frames: {spent:.1f} ms, {memory:.0f} MB, {apart:.2f} mm apart"


def main(
    frames: int = 100_000, models: tuple[str, ...] = MODELS, clear: bool = True, writing: bool = True
) -> None:
    body = load_body()
    table = Table(
        "model",
        "frames",
        "ms, first",
        "ms, last",
        "MB, first",
        "MB, last",
        "MB per 1,000",
        "apart mm, second",
        "apart mm, last",
        "difficult",
    )
    for name in models:
        table.add_row(name, *measured(name, body, frames, clear, writing))
    Console().print(table)


def measured(name: str, body: Body, frames: int, clear: bool, writing: bool) -> list[str]:
    worn = ("bottoms", "tops") if name == "pbns" else ("dress",)
    outfit = Outfit(body, tuple(fit_template(garment, body) for garment in worn))
    clip = load_clip("walk", body)
    there = clip.transforms(torch.float64)
    motion = torch.cat([there, there.flip(0)[1:-1]])
    meshes = [(garment.name, garment.mesh) for garment in outfit.garments]
    course = Course(len(motion))
    roots = drifting_roots(motion, body, clip.fps)
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        paths = [Path(folder) / f"long{suffix}" for suffix in (".pc2", ".usdc")] if writing else []
        writers = [stack.enter_context(open_writer(path, meshes, body, clip.fps)) for path in paths]
        rollout = prepare_rollout(load_method(name, body), outfit, clear).around_root(
            drifting(motion, frames, clip.fps), clip.fps
        )
        for frame in track(rollout, description=name, total=frames):
            course.add(frame, next(roots))
            placed = frame.in_world()
            for writer in writers:
                writer.add(placed.vertices, placed.transforms)
    first, last = course.memory[0], course.memory[-1]
    slope = (last - first) / max(len(course.memory) - 1, 1)
    return [
        f"{frames}",
        f"{course.milliseconds[0]:.1f}",
        f"{course.milliseconds[-1]:.1f}",
        f"{first:.0f}",
        f"{last:.0f}",
        f"{slope:.2f}",
        f"{course.apart[1]:.2f}" if len(course.apart) > 1 else "",
        f"{course.apart[-1]:.2f}",
        f"{course.difficult}",
    ]


def drifting(motion: Tensor, frames: int, fps: float) -> Iterator[Tensor]:
    """The frames of a motion (T, J, 3, 4) over and over, ever farther along x."""
    for index in range(frames):
        transforms = motion[index % len(motion)].clone()
        transforms[:, 0, 3] += SPEED * index / fps
        yield transforms


def drifting_roots(motion: Tensor, body: Body, fps: float) -> Iterator[Tensor]:
    """The root (3,) float64 m, world, of the same frames without end."""
    head = body.skeleton.heads[0].double()
    for transforms in drifting(motion[:, :1], 10**9, fps):
        yield transforms[0, :, :3] @ head + transforms[0, :, 3]


def anonymous_memory() -> float:
    """Memory of this process in MB that is not backed by files (Linux); not a number elsewhere."""
    return process_megabytes("RssAnon")


if __name__ == "__main__":
    tyro.cli(main)
