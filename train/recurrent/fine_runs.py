"""Runs of a cage from sequences of `uvcloth simulate`: the fine cloth's offsets at the cage's points.

Run from the checkout as

    python -m train.recurrent.fine_runs DATA --garment dress --sequences FOLDER

and train on DATA as on a folder of `train.recurrent.cage_runs`. Sequences of the split `validation` go into
DATA/validation, those of the split `test` are left out.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
import tyro
from rich.console import Console

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.dataset.bodies import sequence_body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.dataset.reader import labelled, require_rests, simulated_fabric
from uvcloth.errors import InputError
from uvcloth.files.atomic import make_folder
from uvcloth.files.options import AtLeast
from uvcloth.garments.cage import QUALITIES, Cage
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.mesh import welded
from uvcloth.geometry.skinning import blend_transforms, skin
from uvcloth.methods.recurrent.condition import condition
from uvcloth.motion.index import INDEX, read_index
from uvcloth.physics.fabric import JERSEY
from uvcloth.physics.surface import BodySurface
from uvcloth.process.command import run_command

from .cage_runs import (
    POSED_AT_ONCE,
    VALIDATION,
    CageRun,
    at_rest,
    reference_cage,
    run_file,
    save_run,
)


@torch.no_grad()
def fine_run(path: Path, clip: SimulatedClip, body: Body, quality: str, reference: Cage) -> CageRun:
    """The run of a sequence's only garment. Raises InputError for cloth of another template."""
    (simulated,) = clip.garments
    garment = load_garment(simulated.name, body)
    require_rests({garment.name: garment.mesh.vertices}, [clip], body)
    vertex = welded(garment.mesh.vertices, garment.mesh.faces).kept
    points, weights = garment.mesh.vertices[vertex], garment.smooth_weights[vertex]
    blend = reference.at_cage(weights)
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    resting, skins = [], []
    for some, cloth in zip(
        clip.transforms.split(POSED_AT_ONCE), simulated.vertices.split(POSED_AT_ONCE), strict=True
    ):
        base = skin(points, weights, some)
        offsets = reference.at_cage(cloth[:, vertex].float() - base)
        turns = blend_transforms(blend, some)[..., :3]
        rows = at_rest(turns, reference.at_cage(base), offsets, surface, posed_skin(body, some))
        resting.append(rows[0])
        skins.append(rows[1])
    return CageRun(
        garment=garment.name,
        quality=quality,
        clip=clip.name,
        subject=clip.subject,
        transforms=clip.transforms,
        resting=torch.cat(resting),
        skin=torch.cat(skins),
        blend=blend,
        heads=body.skeleton.heads,
        condition=condition(body, simulated_fabric(clip, str(path)) or JERSEY),
    )


@dataclass(frozen=True)
class FineRuns:
    """Make cage runs of a garment's fine sequences; runs that are there are kept."""

    data: tyro.conf.Positional[Path]
    """Folder of the runs."""
    garment: str
    """Template."""
    sequences: tuple[Path, ...]
    """Folders of `uvcloth simulate`."""
    quality: str = "default"
    """Quality of the cage."""
    every: Annotated[int, AtLeast(1)] = 1
    """Make one of so many runs: one process of several takes `--every 2 --first 1`."""
    first: Annotated[int, AtLeast(0)] = 0
    """Number of the first run to make."""

    def run(self) -> None:
        """Make the runs that are missing, and say how many frames a second of processor time makes."""
        if self.quality not in QUALITIES:
            raise InputError(f"--quality {self.quality}: expected one of {', '.join(QUALITIES)}")
        make_folder(self.data / VALIDATION)
        reference = reference_cage(self.garment, self.quality)
        console, bodies = Console(stderr=True), dict[str, Body]()
        begun, frames = time.process_time(), 0
        for source, target, clip in self._missing():
            body = sequence_body(source, clip.metadata, bodies)
            save_run(fine_run(source, clip, body, self.quality, reference), target)
            frames += len(clip.transforms)
            rate = frames / (time.process_time() - begun)
            console.print(f"{target}, {clip.name}: {frames} frames, {rate:.0f} per CPU second")

    def _missing(self) -> Iterator[tuple[Path, Path, SimulatedClip]]:
        """Sequence, file of its run, and clip; runs are numbered as the sequences are, by name."""
        sources = [path for folder in self.sequences for path in sorted(folder.glob(f"*_{self.garment}.npz"))]
        indexes = {folder: read_index(folder / INDEX) for folder in self.sequences}
        for number in range(self.first, len(sources), self.every):
            source = sources[number]
            entries = indexes[source.parent]
            clip_name = source.stem.removesuffix(f"_{self.garment}")
            split = entries[clip_name].split if clip_name in entries else ""
            folder = {"train": self.data, "validation": self.data / VALIDATION}.get(split)
            if folder is not None and not run_file(folder, number).exists():
                yield source, run_file(folder, number), labelled(load_simulated(source), entries)


if __name__ == "__main__":
    sys.exit(run_command("train.recurrent.fine_runs", lambda: tyro.cli(FineRuns).run()))
