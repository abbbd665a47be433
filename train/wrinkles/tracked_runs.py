"""Runs of fine cloth that tracks a garment on its cage, over captured motion.

Run from the checkout as

    python -m train.wrinkles.tracked_runs DATA --windows index.csv --clips-from mocap --split train

and train on DATA. Each run is a file of the split's folder in DATA; those that are there are kept.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
import tyro
from rich.console import Console
from rich.progress import track as shown
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.commands.options import BodyFile
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.files.atomic import make_folder
from uvcloth.files.fields import check_fields, indices, numbers, text, whole
from uvcloth.files.options import AtLeast
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.garments.refined import Refined
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.motion.index import clip_file, read_index
from uvcloth.motion.library import load_clip
from uvcloth.process.command import run_command
from uvcloth.rollouts.rollout import rollout
from uvcloth.simulation.plan import interleaved
from uvcloth.simulation.run import run_up
from uvcloth.simulation.tracking import FineGarment, Tracking, track

RUN_FORMAT = "uvcloth-tracked-run-2"

LED_IN = 8
"""Frames before the first that is kept, in which fine cloth forgets its start."""

FIELDS = {
    **{name: text() for name in ("garment", "quality", "clip", "subject", "mesh")},
    "fps": numbers(least=1.0, dtype=np.float64),
    "edge": numbers(least=1e-3, dtype=np.float64),
    "transforms": numbers("T", "J", 3, 4),
    "coarse": numbers("L", "N", 3),
    "offsets": numbers("T", "n", 3),
}
"""Arrays of a run's file."""


@dataclass(frozen=True)
class TrackedRun:
    """Fine cloth over a motion of T frames.

    garment, quality: of the cage. clip, subject: of the motion. mesh: fingerprint of the fine mesh. fps: of
    the motion. edge: m, of the fine mesh. transforms: (T, J, 3, 4) of the body. coarse: (T + 2, N, 3) m, the
    garment on its cage, two frames earlier than the rest. offsets: (T, n, 3) m, of the fine cloth from the
    surface that the garment carries, in the world.
    """

    garment: str
    quality: str
    clip: str
    subject: str
    mesh: str
    fps: float
    edge: float
    transforms: Tensor
    coarse: Tensor
    offsets: Tensor

    def __len__(self) -> int:
        return len(self.offsets)


MESH_FORMAT, MESH_FILE = "uvcloth-fine-mesh-1", "fine_mesh.npz"
"""File, in the folder of the runs, of their fine mesh: it takes a minute to make."""

MESH_FIELDS = {
    "edge": numbers(least=1e-3, dtype=np.float64),
    "rest": numbers("n", 3),
    "faces": indices("m", 3, of="n"),
    "corners": whole("n", 3),
    "weights": numbers("n", 3),
}


def fine_mesh(garment: Garment, folder: Path, edge: float | None) -> tuple[FineGarment, float]:
    """The fine mesh of the runs in a folder, made and kept there if there is none, and its edge length, m.

    edge: m, None for that of the file. Raises InputError for a damaged file, for one of another edge length,
    and if there is none and no length is given.
    """
    path = folder / MESH_FILE
    if not path.exists():
        if edge is None:
            raise InputError(f"{path}: is missing; train.wrinkles.tracked_runs makes it")
        fine = FineGarment.of(garment, edge)
        arrays = {name: getattr(fine, name).numpy() for name in ("rest", "faces", "corners", "weights")}
        save_arrays(path, {"format": np.array(MESH_FORMAT), "edge": np.array(edge), **arrays})
        return fine, edge
    data = check_fields(path, load_arrays(path, MESH_FORMAT, "a fine mesh of tracking cloth"), MESH_FIELDS)
    refined = Refined.of(garment.mesh)
    if int(data["corners"].max(initial=0)) >= len(refined.mesh.vertices):
        raise InputError(f"{path}: is of another garment than {garment.name}")
    kept = float(data["edge"])
    if edge is not None and edge != kept:
        raise InputError(
            f"{path}: has edges of {1000 * kept:.1f} mm, not {1000 * edge:.1f}; use another folder"
        )
    rest, weights = (torch.from_numpy(data[name]).float() for name in ("rest", "weights"))
    faces, corners = (torch.from_numpy(data[name]).long() for name in ("faces", "corners"))
    return FineGarment(refined, rest, faces, corners, weights), kept


def fine_mesh_name(fine: FineGarment) -> str:
    """Fingerprint of a fine mesh."""
    return fingerprint("fine", fine.rest, fine.faces)


def save_run(run: TrackedRun, path: Path) -> None:
    """Write a run; offsets in half precision, 0.02 mm at 4 cm. Raises InputError if it cannot be."""
    arrays = {name: np.asarray(value) for name, value in vars(run).items()}
    arrays["offsets"] = run.offsets.half().numpy()
    save_arrays(path, {"format": np.array(RUN_FORMAT), **arrays}, compressed=False)


def load_run(path: Path) -> TrackedRun:
    """Read what `save_run` wrote. Raises InputError naming the file if it is damaged or another format."""
    data = check_fields(
        path, load_arrays(path, RUN_FORMAT, "a run of tracking cloth made by this version"), FIELDS
    )
    texts = {name: str(data[name]) for name in ("garment", "quality", "clip", "subject", "mesh")}
    tensors = {name: torch.from_numpy(data[name]).float() for name in ("transforms", "coarse", "offsets")}
    if len(tensors["coarse"]) != len(tensors["offsets"]) + 2 or len(tensors["transforms"]) != len(
        tensors["offsets"]
    ):
        raise InputError(f"{path}: its arrays are of different numbers of frames")
    values: dict[str, Any] = {**texts, **tensors}
    return TrackedRun(fps=float(data["fps"]), edge=float(data["edge"]), **values)


@torch.no_grad()
def coarse_garment(garment: Garment, body: Body, transforms: Tensor, fps: float, quality: str) -> Tensor:
    """The garment (T, N, 3) m on its cage, over joints (T, J, 3, 4) float64."""
    method = Physics(PhysicsConfig(quality))
    frames = rollout(method, Outfit(body, (garment,)), transforms, fps, keep_going=True)
    return torch.stack([frame.vertices[0] for frame in frames])


@dataclass(frozen=True)
class TrackedRuns:
    """Simulate fine cloth that tracks a garment on its cage, a run for each window of a split."""

    data: tyro.conf.Positional[Path]
    """Folder of the runs."""
    windows: Path
    """Index of the clips."""
    clips_from: Path | None = None
    """Folder of the clips, by default that of the index."""
    split: Literal["train", "validation", "test"] = "train"
    """Split of the index."""
    garment: str = "tops"
    """Template."""
    quality: str = "default"
    """Quality of the cages."""
    edge: float = Tracking.edge
    """Length of the edges of the fine mesh, m."""
    frames: Annotated[int, AtLeast(2)] = 60
    """Frames of a run."""
    runs: Annotated[int, AtLeast(1)] = 1000
    """Runs at most."""
    first: Annotated[int, AtLeast(0)] = 0
    """Number of the first run to make, and every: one of so many."""
    every: Annotated[int, AtLeast(1)] = 1
    """One process of several takes `--every 2 --first 1`."""
    body: BodyFile = None
    """Body, made by `uvcloth body`."""

    @torch.no_grad()
    def run(self) -> None:
        """Make the runs that are missing, and say what a frame of each costs."""
        if self.quality not in QUALITIES:
            raise InputError(f"--quality {self.quality}: expected one of {', '.join(QUALITIES)}")
        folder = self.data / self.split
        make_folder(folder)
        body = load_body(self.body)
        garment = load_garment(self.garment, body)
        console, tracking = Console(stderr=True), Tracking(edge=self.edge)
        fine, _ = fine_mesh(garment, self.data, self.edge)
        name = fine_mesh_name(fine)
        entries = interleaved(e for e in read_index(self.windows).values() if e.split == self.split)
        if not entries:
            raise InputError(f"{self.windows}: has no clip of the split {self.split}")
        for number in range(self.first, min(self.runs, len(entries)), self.every):
            entry = entries[number]
            path = folder / f"{entry.clip}.npz"
            if path.exists():
                continue
            try:
                clip = load_clip(clip_file(entry, self.clips_from or self.windows.parent), body)
                middle = entry.start + max(0, entry.frames - self.frames) // 2
                motion, before = run_up(clip.window(0, entry.start + entry.frames), middle, self.frames)
                transforms = motion.transforms(torch.float64)
                coarse = coarse_garment(garment, body, transforms, motion.fps, self.quality)
                begin, led = max(0, before - LED_IN), min(before, LED_IN)
                begun, vertices = time.thread_time(), []
                steps = track(
                    garment, fine, body, coarse[begin:], transforms[begin:].float(), motion.fps, tracking
                )
                for frame in shown(steps, entry.clip, len(coarse) - begin, transient=True):
                    vertices.append(frame.vertices)
                seconds = (time.thread_time() - begun) / len(vertices)
            except InputError as error:
                console.print(f"{path}: {error}, it is left out")
                continue
            offsets = torch.stack(vertices) - fine.at(coarse[begin:].double())
            if not torch.isfinite(offsets).all():
                console.print(f"{path}: cloth has flown apart, it is left out")
                continue
            held = coarse[begin + max(led - 2, 0) :]
            held = torch.cat([held[:1].expand(max(2 - led, 0), -1, -1), held])
            save_run(
                TrackedRun(
                    garment=garment.name,
                    quality=self.quality,
                    clip=entry.clip,
                    subject=entry.subject,
                    mesh=name,
                    fps=motion.fps,
                    edge=self.edge,
                    transforms=transforms[begin + led :].float(),
                    coarse=held,
                    offsets=offsets[led:],
                ),
                path,
            )
            away = 1000.0 * float(offsets[led:].norm(dim=2).mean())
            console.print(
                f"{path}: {len(offsets) - led} frames, {seconds:.2f} s a frame, {away:.1f} mm off the surface"
            )


if __name__ == "__main__":
    sys.exit(run_command("train.wrinkles.tracked_runs", lambda: tyro.cli(TrackedRuns).run()))
