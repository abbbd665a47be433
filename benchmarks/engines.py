"""Engines on the same scenes: what a frame costs, how far they are apart, and how far each is from itself.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/engines.py [--garments dress] [--clips 26_01] [--slow-frames 20] [--resolutions]

on one thread; UVCLOTH_MOCAP names the folder of index_v2.csv and its clips. Per garment it simulates the
beginning of each window with the explicit engine as it makes data, with a tenth more substeps (what is
chance in a simulation), and on another mesh of the garment (what the mesh decides); then fewer frames with
the slow ones: the explicit engine with eight times the substeps, which stands for the converged solution,
and Blender where UVCLOTH_BLENDER_PYTHON names it. It prints over the frames after the warm-up the
milliseconds of one frame, beside them what the explicit engine takes in the same frames, the shares of the
vertices inside the body and of the edges that run through the cloth, the edges in a frame that are over
twice their length, and the mean distances from the explicit engine's vertices and from the converged ones.

Milliseconds are the thread's own processor time, which a virtual machine that is held up from outside counts
too: they are given as the fastest tenth of the frames takes at most, and the median. The machine's load is
printed.

With --resolutions it prints instead what a frame costs on meshes of other resolutions, of --counts vertices:
with contact of cloth with the body alone, with itself too, and the same with half as many searches for what
is near.
"""

import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import torch
import tyro
from rich.console import Console
from rich.table import Table
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.errors import InputError
from uvcloth.garments.joined import EngineMesh, join
from uvcloth.garments.remesh import remesh, surface_of
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import unique_edges
from uvcloth.geometry.subdivide import halve_edges
from uvcloth.motion.clip import Clip
from uvcloth.motion.index import read_index
from uvcloth.motion.lead_in import LeadIn
from uvcloth.motion.library import load_clip
from uvcloth.physics.cloth.solver import Settings
from uvcloth.physics.fabric import Fabric
from uvcloth.process.command import run_command
from uvcloth.simulation.blender import PYTHON_VARIABLE, find_blender
from uvcloth.simulation.engine import Engine, Frame, Scene
from uvcloth.simulation.explicit import Explicit
from uvcloth.simulation.quality_check import examine
from uvcloth.simulation.remeshed import Remeshed
from uvcloth.simulation.run import run_up, simulate

MOCAP = Path(os.environ.get("UVCLOTH_MOCAP", Path(__file__).parents[2] / "shared" / "mocap"))

COUNTS = (450, 900, 3600, 14400)
"""Vertices of the meshes whose cost is compared, about; above the template's number it is subdivided."""


EXPLICIT, CONVERGED, BLENDER = "explicit", "eight times the substeps", "blender"
FAST = (EXPLICIT, "a tenth more substeps", "another mesh")


@dataclass
class Resampled:
    """An engine on a mesh of the cloth that has about `count` vertices, then as many as it has.

    Its frames are the skinned garment: what counts are the seconds of processor time that each took.
    """

    engine: Engine
    count: int
    seconds: list[float] = field(default_factory=list)

    def describe(self) -> dict[str, Any]:
        return self.engine.describe()

    def with_fabric(self, fabric: Fabric) -> Self:
        return replace(self, engine=self.engine.with_fabric(fabric))

    def simulate(self, scene: Scene, after: Frame | None = None) -> Iterator[Frame]:
        other = _resampled(scene, self.count)
        self.count = len(other.rest)
        began = time.thread_time()
        for frame in self.engine.simulate(other, after):
            self.seconds.append(time.thread_time() - began)
            yield Frame(frame.index, scene.skinned[frame.index])
            began = time.thread_time()


def _resampled(scene: Scene, count: int) -> Scene:
    """The scene with a mesh of about `count` vertices: the same, a coarser one, or with its edges halved."""
    if count > 2 * len(scene.rest):
        band, mass, touches = scene.band[:, None].float(), scene.mass_factor[:, None], scene.touches.T.float()
        skinned = scene.skinned.permute(1, 0, 2).flatten(1)
        columns = (scene.rest, skinned, band, mass, scene.inner_thickness[:, None], touches)
        halved, faces = halve_edges(torch.cat(columns, 1), scene.faces)
        rest, skinned, band, mass, thickness, touches = halved.split([part.shape[1] for part in columns], 1)
        held = band[:, 0] == 1.0
        return replace(
            scene,
            rest=rest.contiguous(),
            faces=faces,
            band=held,
            mass_factor=torch.where(held, mass[:, 0], 1.0),
            inner_thickness=thickness[:, 0],
            skinned=skinned.unflatten(1, (-1, 3)).permute(1, 0, 2).contiguous(),
            touches=(touches.T > 0.0).contiguous(),
        )
    if count >= len(scene.rest):
        return scene
    points, triangles = remesh(scene.rest.double().numpy(), scene.faces.numpy(), count)
    found = surface_of(scene.rest.double().numpy(), scene.faces.numpy()).closest(
        torch.from_numpy(points).float()
    )
    corners, weights = scene.faces[found.faces], found.barycentrics[:, :, None]
    near = corners.gather(1, found.barycentrics.argmax(1, keepdim=True))[:, 0]
    return replace(
        scene,
        rest=(scene.rest[corners] * weights).sum(1),
        faces=torch.from_numpy(triangles),
        band=scene.band[near],
        mass_factor=scene.mass_factor[near],
        inner_thickness=scene.inner_thickness[near],
        skinned=(scene.skinned[:, corners] * weights).sum(2),
        touches=scene.touches[:, near],
    )


@dataclass(frozen=True)
class Run:
    """A simulated window. seconds: (F,) of processor time that each frame took."""

    sequence: SimulatedClip
    seconds: Tensor

    def scored(self, frames: int) -> tuple[Tensor, Tensor]:
        """Vertices (F, N, 3) m and seconds (F,) of the first frames after the warm-up."""
        rows = slice(self.sequence.warm_up, self.sequence.warm_up + frames)
        return self.sequence.vertices[rows], self.seconds[rows]


def main(
    garments: tuple[str, ...] = ("tops", "bottoms", "dress"),
    clips: tuple[str, ...] = ("26_01", "11_01", "31_01"),
    frames: int = 75,
    slow_frames: int = 20,
    resolutions: bool = False,
    counts: tuple[int, ...] = COUNTS,
) -> None:
    """Compare engines on the beginnings of windows.

    garments: templates. clips: of the index. frames: of each window. slow_frames: for slow engines, or 0.
    """
    torch.set_num_threads(1)
    torch.set_grad_enabled(False)
    body = load_body()
    motions = {clip: _motion(clip, body) for clip in clips}
    print("load of the machine:", *(f"{load:.2f}" for load in os.getloadavg()))
    for garment in garments:
        cloth = join(fit_template(garment, body), body)
        if resolutions:
            table = _resolutions(cloth, motions, frames, body, counts)
        else:
            table = _engines(cloth, motions, frames, slow_frames, body)
        Console(width=160).print(table)
    print("load of the machine:", *(f"{load:.2f}" for load in os.getloadavg()))


def _motion(name: str, body: Body) -> tuple[Clip, int, int]:
    """Clip of the index, start and frames of its window."""
    entries = read_index(MOCAP / "index_v2.csv")
    if name not in entries:
        raise InputError(f"{MOCAP / 'index_v2.csv'}: has no clip {name}")
    entry = entries[name]
    return load_clip(MOCAP / entry.file, body), entry.start, entry.frames


def _run(engine: Engine, cloth: EngineMesh, motion: tuple[Clip, int, int], frames: int, body: Body) -> Run:
    """Simulate the beginning of a window, as data are made."""
    clip, start, most = motion
    window, before = run_up(clip, start, min(frames, most))
    clocks: list[float] = []
    made = simulate(
        window, before, (cloth,), body, engine, LeadIn(), lambda _: clocks.append(time.thread_time())
    )
    return Run(made, torch.tensor(clocks, dtype=torch.float64).diff())


def _engines(
    cloth: EngineMesh, motions: dict[str, tuple[Clip, int, int]], frames: int, slow_frames: int, body: Body
) -> Table:
    table = Table(
        *(cloth.garment.name, "frames", "ms a frame", "explicit's", "inside, %", "crossing, %"),
        *("edges over twice", *(f"{clip}: mm" for clip in motions), "all: mm", "from converged: mm"),
    )
    runs = {
        name: {clip: _run(engine, cloth, motion, count, body) for clip, motion in motions.items()}
        for name, (engine, count) in _settings(frames, slow_frames).items()
    }
    ours, converged = runs[EXPLICIT], runs.get(CONVERGED)
    for name, row in runs.items():
        count = frames if name in FAST else slow_frames
        scored = [run.scored(count) for run in row.values()]
        beside = [ours[clip].scored(len(vertices)) for clip, (vertices, _) in zip(row, scored, strict=True)]
        examined = [
            examine(run.sequence, [cloth.garment], body)[0].garments[0].metadata for run in row.values()
        ]
        apart = _distances(row, ours, count)
        table.add_row(
            name,
            str(sum(len(vertices) for vertices, _ in scored)),
            "-" if name == BLENDER else _cost([seconds for _, seconds in scored]),
            _cost([seconds for _, seconds in beside]),
            *(
                f"{sum(each[key] for each in examined) / len(examined):.3f}"
                for key in ("inside_percent", "crossing_percent")
            ),
            f"{sum(_long_edges(run, count) for run in row.values()) / len(row):.2f}",
            *("-" if row is ours else _mean([each]) for each in (*apart, torch.cat(apart))),
            "-" if converged is None or converged is row else _mean(_distances(row, converged, slow_frames)),
        )
    return table


def _settings(frames: int, slow_frames: int) -> dict[str, tuple[Engine, int]]:
    """Engines by name, and the frames that each simulates."""
    fast: tuple[Engine, ...] = (Explicit(), Explicit().with_more_substeps(0.1), Remeshed(Explicit()))
    slow: dict[str, Engine] = {CONVERGED: Explicit().with_more_substeps(7.0)}
    if PYTHON_VARIABLE in os.environ:
        slow[BLENDER] = find_blender()
    return {name: (engine, frames) for name, engine in zip(FAST, fast, strict=True)} | {
        name: (engine, slow_frames) for name, engine in slow.items() if slow_frames
    }


def _distances(runs: dict[str, Run], others: dict[str, Run], frames: int) -> list[Tensor]:
    """Mean distance (F,) m between two engines in the first frames of each window that both have."""
    pairs = [(run.scored(frames)[0], others[clip].scored(frames)[0]) for clip, run in runs.items()]
    both = [min(len(one), len(other)) for one, other in pairs]
    return [
        (one[:rows] - other[:rows]).norm(dim=-1).mean(1)
        for (one, other), rows in zip(pairs, both, strict=True)
    ]


def _resolutions(
    cloth: EngineMesh,
    motions: dict[str, tuple[Clip, int, int]],
    frames: int,
    body: Body,
    counts: tuple[int, ...],
) -> Table:
    settings = {
        "body alone: ms": Settings(self_contact=False),
        "and self-contact: ms": Settings(),
        "half the searches: ms": Settings(interval=2.0 * Settings().interval),
    }
    table = Table(cloth.garment.name, *settings)
    for count in counts:
        row = []
        for each in settings.values():
            engine = Explicit(settings=each)
            runs = [_timed(engine, cloth, motion, count, frames, body) for motion in motions.values()]
            row.append(_cost([torch.tensor(run.seconds) for run in runs]))
        table.add_row(str(runs[0].count), *row)
    return table


def _timed(
    engine: Engine, cloth: EngineMesh, motion: tuple[Clip, int, int], count: int, frames: int, body: Body
) -> Resampled:
    """The engine on another mesh, with the times of the frames after the warm-up."""
    clip, start, most = motion
    window, before = run_up(clip, start, min(frames, most))
    made = Resampled(engine, count)
    simulate(window, before, (cloth,), body, made, LeadIn())
    return replace(made, seconds=made.seconds[before + len(LeadIn()) :])


def _mean(values: list[Tensor]) -> str:
    """Mean of all, in thousandths."""
    return f"{1e3 * float(torch.cat(values).mean()):.1f}"


def _cost(seconds: list[Tensor]) -> str:
    """Milliseconds below which the fastest tenth of the frames is, and half of them."""
    few, half = (float(torch.cat(seconds).quantile(share)) for share in (0.1, 0.5))
    return f"{1e3 * few:.1f}, {1e3 * half:.1f}"


def _long_edges(run: Run, frames: int) -> float:
    """Edges of a frame that are over twice as long as at rest."""
    (garment,) = run.sequence.garments
    edges, rest = unique_edges(garment.faces), garment.rest
    lengths = (rest[edges[:, 0]] - rest[edges[:, 1]]).norm(dim=-1)
    vertices, _ = run.scored(frames)
    moved = (vertices[:, edges[:, 0]] - vertices[:, edges[:, 1]]).norm(dim=-1)
    return float((moved > 2.0 * lengths).sum(1).float().mean())


if __name__ == "__main__":
    sys.exit(run_command("engines", lambda: tyro.cli(main)))
