"""Runs of the solver on a garment's cage over training motion, made as fast as they are learned from.

Run from the checkout as

    python -m train.recurrent.cage_runs DATA --garment dress --windows index.csv --clips-from mocap --runs 300

beside a training on DATA: each run is a file, which the training takes in when it validates next. Clips of
the index's split `validation` come first, into DATA/validation.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro
from rich.console import Console
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.commands.options import BodyFile
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.files.atomic import make_folder
from uvcloth.files.fields import check_fields, numbers, text
from uvcloth.files.options import AtLeast
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.methods.physics.outfit import CagedOutfit, PhysicsConfig, dressed, make_caged_outfit, next_frame
from uvcloth.process.command import run_command

from .motions import FPS, Motions

RUN_FORMAT = "uvcloth-cage-run-1"

FIELDS = {
    "garment": text(),
    "quality": text(),
    "clip": text(),
    "subject": text(),
    "transforms": numbers("T", "J", 3, 4),
    "offsets": numbers("T", "n", 3),
}
"""Arrays of a run's file."""

POSED_AT_ONCE = 32
"""Frames whose body is posed at once."""


@dataclass(frozen=True)
class CageRun:
    """A cage over a motion of T frames.

    garment: name. quality: of its cage. clip, subject: of the motion. transforms: (T, J, 3, 4) of the body.
    offsets: (T, n, 3) m, world axes, from the smoothly skinned cage.
    """

    garment: str
    quality: str
    clip: str
    subject: str
    transforms: Tensor
    offsets: Tensor


VALIDATION = "validation"
"""Folder, in that of the runs, of the runs of validation clips."""


def run_file(folder: Path, number: int) -> Path:
    """The file of a run."""
    return folder / f"{number:05d}.npz"


def run_files(folder: Path) -> list[Path]:
    """Files of the runs in a folder, by number."""
    return sorted(folder.glob("[0-9]*.npz"))


def save_run(run: CageRun, path: Path) -> None:
    """Write a run; offsets in half precision, which is 0.2 mm at 0.3 m. Raises InputError if it cannot be."""
    texts = {name: np.array(getattr(run, name)) for name in ("garment", "quality", "clip", "subject")}
    arrays = {"transforms": run.transforms.numpy(), "offsets": run.offsets.half().numpy()}
    save_arrays(path, {"format": np.array(RUN_FORMAT), **texts, **arrays}, compressed=False)


def load_run(path: Path) -> CageRun:
    """Read what `save_run` wrote. Raises InputError naming the file if it is damaged or another format."""
    data = check_fields(path, load_arrays(path, RUN_FORMAT, "a run of a cage made by this version"), FIELDS)
    return CageRun(
        garment=str(data["garment"]),
        quality=str(data["quality"]),
        clip=str(data["clip"]),
        subject=str(data["subject"]),
        transforms=torch.from_numpy(data["transforms"]),
        offsets=torch.from_numpy(data["offsets"]).float(),
    )


@torch.no_grad()
def simulate_cage(prepared: CagedOutfit, body: Body, transforms: Tensor) -> Tensor:
    """Offsets (T, n, 3) m of a cage from the skinned one; cloth is at rest before the first frame.

    Raises FloatingPointError where cloth flies apart.
    """
    offsets, state = [], None
    for some in transforms.split(POSED_AT_ONCE):
        for transform, vertices in zip(some, posed_skin(body, some), strict=True):
            targets = prepared.skinned_cages(transform)
            if state is None:
                state = dressed(prepared, body, transform)
            else:
                state = next_frame(prepared, state, prepared.collider(vertices), targets, 0.0, FPS)
            offsets.append(torch.from_numpy((state.cloth.vertices() - targets).astype(np.float32)))
    stacked = torch.stack(offsets)
    if not torch.isfinite(stacked).all():
        raise FloatingPointError("cloth flew apart")
    return stacked


@dataclass(frozen=True)
class CageRuns:
    """Simulate a garment's cage over training motion; runs that are there are kept."""

    data: tyro.conf.Positional[Path]
    """Folder of the runs."""
    garment: str
    """Template."""
    windows: Path
    """Index of the clips: its splits `validation`, each clip once, and `train`."""
    clips_from: Path | None = None
    """Folder of the clips, by default that of the index."""
    quality: str = "fast"
    """Quality of the cage."""
    runs: Annotated[int, AtLeast(1)] = 300
    """Number of runs in the folder at the end."""
    every: Annotated[int, AtLeast(1)] = 1
    """Make one of so many runs: one process of several takes `--every 2 --first 1`."""
    first: Annotated[int, AtLeast(0)] = 0
    """Number of the first run to make."""
    seed: int = 0
    """Random seed of the motions."""
    body: BodyFile = None
    """A body made by `uvcloth body`."""

    def run(self) -> None:
        """Make the runs that are missing, and say how many frames a second of processor time makes."""
        if self.quality not in QUALITIES:
            raise InputError(f"--quality {self.quality}: expected one of {', '.join(QUALITIES)}")
        make_folder(self.data / VALIDATION)
        body = load_body(self.body)
        missing = list(self._missing(body))
        if not missing:
            return
        garment = load_garment(self.garment, body)
        prepared = make_caged_outfit(Outfit(body, (garment,)), PhysicsConfig(self.quality))
        console = Console(stderr=True)
        begun, frames = time.process_time(), 0
        for path, motions, number in missing:
            entry, transforms = motions.entry(number), motions.transforms(number)
            try:
                offsets = simulate_cage(prepared, body, transforms)
            except FloatingPointError as error:
                console.print(f"{path}: {error} in the clip {entry.clip}, it is left out")
                continue
            save_run(
                CageRun(garment.name, self.quality, entry.clip, entry.subject, transforms, offsets), path
            )
            frames += len(offsets)
            rate = frames / (time.process_time() - begun)
            console.print(f"{path}, {entry.clip}: {frames} frames, {rate:.0f} per CPU second")

    def _missing(self, body: Body) -> Iterator[tuple[Path, Motions, int]]:
        """The file of each run to make, the motions, and its number among them."""
        for split, folder in (("validation", self.data / VALIDATION), ("train", self.data)):
            motions = Motions.of_split(split, self.windows, self.clips_from, body, self.seed)
            runs = self.runs if split == "train" else len(motions.entries)
            for number in range(self.first, runs, self.every):
                if not run_file(folder, number).exists():
                    yield run_file(folder, number), motions, number


if __name__ == "__main__":
    sys.exit(run_command("train.recurrent.cage_runs", lambda: tyro.cli(CageRuns).run()))
