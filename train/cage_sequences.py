"""Sequences of garments over training motion, simulated on cages: more motion than fine cloth has time for.

Run from the checkout as

    python -m train.cage_sequences DATA --windows index.csv --clips-from mocap

and train on DATA as on a folder of `uvcloth simulate`. Each motion is a clip of the index's split `train`, at
first as it was captured, then varied (`train.recurrent.motions`); sequences that are there are kept.
"""

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
import tyro
from rich.console import Console
from torch import Tensor

from uvcloth.bodies.body import load_body
from uvcloth.commands.options import BodyFile
from uvcloth.dataset.bodies import keep_body
from uvcloth.dataset.clip import SimulatedClip, SimulatedGarment
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.errors import InputError
from uvcloth.files.atomic import make_folder
from uvcloth.files.options import AtLeast
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.methods.physics.dressed import dressed, move_on
from uvcloth.methods.physics.outfit import CagedOutfit, PhysicsConfig, make_caged_outfit
from uvcloth.process.command import run_command
from uvcloth.simulation.run import RUN_UP

from .recurrent.motions import FPS, Motions


@dataclass(frozen=True)
class CageSequences:
    """Simulate garments on cages over training motion, each by itself, and write them as sequences."""

    data: tyro.conf.Positional[Path]
    """Folder of the sequences."""
    windows: Path
    """Index of the clips: its split `train`."""
    clips_from: Path | None = None
    """Folder of the clips, by default that of the index."""
    garments: tuple[str, ...] = ("tops", "bottoms", "dress")
    """Templates."""
    quality: str = "default"
    """Quality of the cages."""
    motions: Annotated[int, AtLeast(1)] = 149
    """Number of motions."""
    most_frames: Annotated[int | None, AtLeast(2)] = None
    """Frames of a motion that are simulated, None for all."""
    first: Annotated[int, AtLeast(0)] = 0
    """Number of the first motion."""
    seed: int = 0
    """Random seed of the motions."""
    body: BodyFile = None
    """Body, made by `uvcloth body`."""

    def run(self) -> None:
        """Make the sequences that are missing, and say how many frames a second of processor time makes."""
        if self.quality not in QUALITIES:
            raise InputError(f"--quality {self.quality}: expected one of {', '.join(QUALITIES)}")
        make_folder(self.data)
        body = load_body(self.body)
        keep_body(body, self.data)
        config = PhysicsConfig(self.quality)
        outfits = [Outfit(body, (load_garment(name, body),)) for name in self.garments]
        prepared = [make_caged_outfit(outfit, config) for outfit in outfits]
        motions = Motions.of_split("train", self.windows, self.clips_from, body, self.seed)
        console = Console(stderr=True)
        begun, frames = time.process_time(), 0
        for number in range(self.first, self.motions):
            entry, again = motions.entry(number), number // len(motions.entries)
            name = f"{entry.clip}_varied{again}" if again else entry.clip
            paths = [self.data / f"{name}_{outfit.garments[0].name}.npz" for outfit in outfits]
            if all(path.exists() for path in paths):
                continue
            transforms = motions.transforms(number)[: self.most_frames]
            labels = {"split": entry.split, "subject": entry.subject, "action": entry.action}
            for outfit, ready, path in zip(outfits, prepared, paths, strict=True):
                try:
                    draped = torch.stack(list(simulated(ready, transforms)))
                except InputError as error:
                    console.print(f"{path}: {error}, it is left out")
                    continue
                warm_up = min(RUN_UP, len(draped) - 1)
                clip = cage_clip(name, outfit, [draped], transforms, warm_up, self.quality, self.seed)
                save_simulated(clip.labelled(**labels), path)
                frames += len(draped)
            rate = frames / (time.process_time() - begun)
            console.print(f"{name}: {frames} frames, {rate:.0f} per CPU second")


def cage_clip(
    name: str,
    outfit: Outfit,
    draped: Sequence[Tensor],
    transforms: Tensor,
    warm_up: int,
    quality: str,
    seed: int,
) -> SimulatedClip:
    """The clip of an outfit on cages, each garment (F, N, 3) m."""
    body = outfit.body
    metadata = {
        "clip": name,
        "body": body.name,
        "body_hash": body.identity.shape,
        "seed": seed,
        "engine": "cages",
        "settings": {"quality": quality, "fabric": vars(outfit.garments[0].fabric)},
        "layers": [garment.name for garment in outfit.garments],
    }
    garments = tuple(
        SimulatedGarment(
            garment.name,
            cloth,
            garment.mesh.faces,
            garment.mesh.vertices,
            {"template": garment.template, "source": garment.source},
        )
        for garment, cloth in zip(outfit.garments, draped, strict=True)
    )
    return SimulatedClip(garments, transforms, FPS, warm_up, metadata)


def simulated(prepared: CagedOutfit, transforms: Tensor) -> Iterator[Tensor]:
    """Yield the garment (N, 3) m of each frame as its cage carries it, not cleared; it begins at rest.

    Raises InputError where cloth flies apart.
    """
    (garment,) = prepared.garments
    cloth = dressed(prepared, transforms[0])
    for transform in transforms:
        move_on(cloth, transform, FPS)
        (points,) = prepared.followed(transform, cloth.cages())
        yield points[garment.mesh.places]


if __name__ == "__main__":
    sys.exit(run_command("train.cage_sequences", lambda: tyro.cli(CageSequences).run()))
