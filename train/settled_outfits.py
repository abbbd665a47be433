"""Sequences of outfits at rest in many poses, settled on cages: far more poses than fine cloth has time for.

Run from the checkout as

    python -m train.settled_outfits DATA --wardrobe WARDROBE --poses poses.npz

and name DATA among the folders of `uvcloth train deepsd --data`. Each outfit of the split `train`, and each
template on each of their bodies, is settled in its own draw of the training poses; the frames of a sequence
are these poses. Sequences that are there are kept.
"""

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import tyro
from rich.console import Console
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.dataset.bodies import keep_body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.errors import InputError
from uvcloth.files.atomic import make_folder
from uvcloth.files.options import AtLeast
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.methods.physics.outfit import PhysicsConfig, make_caged_outfit
from uvcloth.motion.poses import PoseDatabase, load_poses
from uvcloth.physics.self_contact import SelfContact
from uvcloth.process.command import run_command
from uvcloth.wardrobe.outfit_file import OutfitFile, load_outfit_file, on_body, outfit_files

from .cage_sequences import cage_clip
from .settled import settle

SETTLED = "settled"
"""Name of the clip of an outfit; that of a template is followed by its body."""


@dataclass(frozen=True)
class Task:
    """An outfit to settle: its clip, the names of its garments, how it is read, and what is known of it."""

    clip: str
    garments: tuple[str, ...]
    read: Callable[[], Outfit]
    labels: dict[str, Any]


@dataclass(frozen=True)
class SettledOutfits:
    """Settle random outfits, and templates on the same bodies, in training poses; write them as sequences."""

    data: tyro.conf.Positional[Path]
    """Folder of the sequences."""
    wardrobe: Path
    """Folder of `uvcloth outfits`: its split `train`."""
    poses: Path
    """Poses drawn by `uvcloth poses`: of the split `train`, those in which no body runs through itself."""
    templates: tuple[str, ...] = ("tops", "bottoms", "dress")
    """Templates, each on every body of these outfits."""
    each: Annotated[int, AtLeast(2)] = 24
    """Poses of an outfit."""
    quality: str = "default"
    """Quality of the cages."""
    every: Annotated[int, AtLeast(1)] = 1
    """Settle one of so many outfits: one process of several takes `--every 2 --first 1`."""
    first: Annotated[int, AtLeast(0)] = 0
    """Number of the first outfit."""
    seed: int = 0
    """Random seed of the draws of poses."""

    def run(self) -> None:
        """Make the sequences that are missing, and say how many poses a second of processor time settles."""
        if self.quality not in QUALITIES:
            raise InputError(f"--quality {self.quality}: expected one of {', '.join(QUALITIES)}")
        make_folder(self.data)
        tasks = list(self._tasks())[self.first :: self.every]
        console = Console(stderr=True)
        begun, poses = time.process_time(), 0
        for number, task in enumerate(tasks, start=1):
            paths = [self.data / f"{task.clip}_{garment}.npz" for garment in task.garments]
            if all(path.exists() for path in paths):
                continue
            outfit = task.read()
            try:
                clip = self._settled(task, outfit)
            except InputError as error:
                console.print(f"{paths[0]}: left out, {error}")
                continue
            keep_body(outfit.body, self.data)
            save_simulated(clip, *paths)
            poses += len(clip.transforms)
            rate = poses / (time.process_time() - begun)
            console.print(
                f"{number} of {len(tasks)}, {paths[0].stem}: {poses} poses, {rate:.1f} per CPU second"
            )

    def _tasks(self) -> Iterator[Task]:
        """The training outfits of the wardrobe, then the templates on their bodies."""
        files = [file for file in map(load_outfit_file, outfit_files(self.wardrobe)) if file.split == "train"]
        for file in files:
            yield _of_wardrobe(file)
        for path in sorted({file.body for file in files}):
            for template in self.templates:
                yield _of_template(template, path)

    def _settled(self, task: Task, outfit: Outfit) -> SimulatedClip:
        """The clip of an outfit in its draw of poses. Raises InputError if it cannot be settled."""
        prepared = make_caged_outfit(outfit, PhysicsConfig(self.quality))
        generator = np.random.default_rng([self.seed, *f"{task.clip}_{task.garments[0]}".encode()])
        poses = load_poses(self.poses, outfit.body)
        transforms = _drawn(poses, outfit.body, self.each, generator)
        settled = [settle(prepared, pose) for pose in transforms]
        draped = [torch.stack(cloth) for cloth in zip(*settled, strict=True)]
        if not all(torch.isfinite(cloth).all() for cloth in draped):
            raise InputError("its cloth flew apart")
        return cage_clip(task.clip, outfit, draped, transforms, 0, self.quality, self.seed).labelled(
            split="train", captured=poses.clips_of("train"), **task.labels
        )


def _of_wardrobe(file: OutfitFile) -> Task:
    """A random outfit, on its body and in its fabric."""

    def read() -> Outfit:
        outfit = on_body(file)
        garments = tuple(replace(garment, fabric=file.fabric) for garment in outfit.garments)
        return replace(outfit, garments=garments)

    names = tuple(piece.file.stem for piece in file.pieces)
    types = {piece.file.stem: piece.design.kind for piece in file.pieces}
    return Task(SETTLED, names, read, {"outfit": file.name, "fabric": file.fabric_name, "types": types})


def _of_template(template: str, body_file: Path) -> Task:
    """A template on a body, of jersey."""

    def read() -> Outfit:
        body = load_body(body_file)
        return Outfit(body, (load_garment(template, body),))

    return Task(f"{SETTLED}_{body_file.stem}", (template,), read, {})


def _drawn(poses: PoseDatabase, body: Body, count: int, generator: np.random.Generator) -> Tensor:
    """Joint transforms (count, J, 3, 4) of training poses that a body can take, fewer if few are."""
    training = poses.of("train")
    clear = SelfContact(body).clear
    drawn: list[Tensor] = []
    for row in generator.permutation(len(training)):
        if len(drawn) == count:
            break
        pose = training.select(torch.tensor([row])).transforms(body.skeleton)
        if clear(posed_skin(body, pose)[0]):
            drawn.append(pose[0])
    return torch.stack(drawn)


if __name__ == "__main__":
    sys.exit(run_command("train.settled_outfits", lambda: tyro.cli(SettledOutfits).run()))
