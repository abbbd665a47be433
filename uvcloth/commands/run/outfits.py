"""Folders of random outfits, and the bodies that wear them."""

import os
from collections import Counter
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

from uvcloth.bodies.body import Body, load_body, save_body
from uvcloth.commands.outfits import Outfits
from uvcloth.commands.run.body import anny_progress
from uvcloth.commands.run.outfit_sheet import draw_sheet
from uvcloth.errors import InputError
from uvcloth.files.atomic import sole_writer
from uvcloth.motion.poses import SPLITS
from uvcloth.process.pool import pool
from uvcloth.wardrobe.draw import OUTFITS
from uvcloth.wardrobe.make import make_outfit
from uvcloth.wardrobe.outfit_file import (
    OutfitFile,
    PieceFile,
    load_outfit_file,
    outfit_files,
    save_outfit_file,
)
from uvcloth.writers.obj import save_obj

BUILTIN = "builtin"
"""Name of the body that ships with the package."""

PHENOTYPES = {
    "gender": (0.0, 1.0),
    "age": (0.5, 0.9),
    "muscle": (0.2, 0.9),
    "weight": (0.2, 0.8),
    "height": (0.25, 0.8),
    "proportions": (0.3, 1.0),
}
"""Ranges of drawn bodies: adults."""

HELD_OUT = 6
"""One in this many bodies is for validation, and another one for the test."""


@dataclass(frozen=True)
class _OutfitJob:
    number: int
    body: Path
    settings: Outfits


@dataclass(frozen=True)
class _Made:
    """Result of a job: reasons of refused draws, and the reason for no outfit, "" if there is one."""

    refused: tuple[str, ...] = ()
    failed: str = ""


def run(command: Outfits) -> None:
    """Make the outfits that are missing. Raises InputError for bad input."""
    make_outfits(command)
    if command.picture is not None:
        draw_sheet(outfit_files(command.out), command.picture)


def make_outfits(settings: Outfits) -> None:
    """Make the missing outfits of a folder; each appears complete or not at all.

    Raises InputError for settings out of range, bodies that outfits cannot be cut on, and a folder that was
    made with other settings.
    """
    settings.check()
    with sole_writer(settings.out):
        _make_missing(settings)


def _make_missing(settings: Outfits) -> None:
    bodies = _bodies(settings)
    jobs = [
        _OutfitJob(number, wearer(number, bodies, settings.seed), settings)
        for number in range(1, settings.count + 1)
    ]
    todo = [job for job in jobs if not _is_there(job)]
    console = Console(stderr=True)
    refused: list[str] = []
    count = min(settings.jobs or os.cpu_count() or 1, len(todo))
    workers = pool(_make, count, "made outfits") if count > 1 else nullcontext(partial(map, _make))
    with workers as made, Progress(console=console) as progress:
        bar = progress.add_task(f"{len(todo)} outfits", total=len(todo))
        for done, each in enumerate(made(todo), start=1):
            refused += each.refused
            progress.advance(bar)
            if each.failed:
                progress.console.print(each.failed, soft_wrap=True)
            if not console.is_terminal and (done % 25 == 0 or done == len(todo)):
                print(f"{done} of {len(todo)} outfits", flush=True)
    print(f"{settings.out}: {len(jobs) - len(todo)} outfits were there, {len(todo)} were missing")
    if refused:
        print(f"{len(refused)} draws were refused and drawn again, the last: {refused[-1]}")


def split_of(number: int) -> str:
    """Split of an outfit by its number: of every ten one is for validation and one for the test."""
    return SPLITS[max(0, number % 10 - 7)]


def _make(job: _OutfitJob) -> _Made:
    """Make and write one outfit, its pieces first."""
    import torch

    torch.set_num_threads(1)
    settings = job.settings
    types = settings.type or OUTFITS
    path = _path(job)
    try:
        made = make_outfit(job.number, settings.seed, types, settings.vertices, _loaded(job.body))
    except InputError as error:
        return _Made(failed=f"{path.stem}: left out, {error}")
    files = [path.with_name(f"{path.stem}_{design.kind}.obj") for design in made.drawn.designs]
    for mesh, file in zip(made.pieces, files, strict=True):
        save_obj(mesh, file)
    drawn = made.drawn
    save_outfit_file(
        OutfitFile(
            path=path,
            name=path.stem,
            split=split_of(job.number),
            body=job.body,
            seed=settings.seed,
            pieces=tuple(
                PieceFile(file, design, len(mesh.vertices))
                for file, design, mesh in zip(files, drawn.designs, made.pieces, strict=True)
            ),
            fabric_name=drawn.fabric_name,
            fabric=drawn.fabric,
            tightness=drawn.tightness,
            even=drawn.meshing.even,
            seams=drawn.meshing.seams,
            vertex_range=settings.vertices,
        )
    )
    return _Made(made.refused)


def _path(job: _OutfitJob) -> Path:
    return job.settings.out / f"o{job.number:04d}.json"


def _is_there(job: _OutfitJob) -> bool:
    """Test for an outfit that was made before. Raises InputError if it was made with other settings."""
    path = _path(job)
    if not path.is_file():
        return False
    outfit = load_outfit_file(path)
    worn = "+".join(piece.design.kind for piece in reversed(outfit.pieces))
    made = (outfit.seed, outfit.vertex_range, outfit.body)
    if made != (job.settings.seed, job.settings.vertices, job.body):
        raise InputError(
            f"{path}: was made with --seed {made[0]} --vertices {made[1][0]} {made[1][1]} on {made[2].stem}, "
            "use another folder for other settings"
        )
    if worn not in (job.settings.type or OUTFITS):
        raise InputError(f"{path}: has the type {worn}, which --type leaves out; use another folder")
    return True


@cache
def _loaded(path: Path) -> Body:
    return load_body(path)


def wearer(number: int, bodies: Sequence[Path], seed: int) -> Path:
    """Body that wears an outfit: each split has separate bodies, if there are several."""
    if len(bodies) == 1:
        return bodies[0]
    held = max(1, len(bodies) // HELD_OUT)
    by_split = {
        "test": bodies[-held:],
        "validation": bodies[-2 * held : -held],
        "train": bodies[: -2 * held],
    }[split_of(number)]
    return by_split[int(np.random.default_rng([seed, number]).integers(len(by_split)))]


def _bodies(settings: Outfits) -> list[Path]:
    """Files of the bodies in OUT/bodies, made or copied if missing."""
    folder = settings.out / "bodies"
    if not settings.body:
        return _drawn_bodies(folder, settings.bodies, settings.seed)
    names = [BUILTIN if name == BUILTIN else Path(name).stem for name in settings.body]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f"--body: two bodies are named {twice[0]}")
    files = []
    for given, name in zip(settings.body, names, strict=True):
        body = load_body(None if given == BUILTIN else Path(given))
        if "tights" not in body.proxies:
            raise InputError(f"--body {given}: has no garment proxy, outfits cannot be cut on it")
        file = folder / f"{name}.npz"
        if not file.is_file():
            save_body(replace(body, name=name), file)
        files.append(file)
    return files


def _drawn_bodies(folder: Path, count: int, seed: int) -> list[Path]:
    files = [folder / f"b{number:02d}.npz" for number in range(1, count + 1)]
    missing = [number for number, file in enumerate(files, start=1) if not file.is_file()]
    if not missing:
        return files
    from uvcloth.bodies.anny import make_body

    with anny_progress() as progress:
        task = progress.add_task("bodies", total=None)
        for number in missing:
            rng = np.random.default_rng([seed, number, len(PHENOTYPES)])
            drawn = {key: round(float(rng.uniform(*ends)), 3) for key, ends in PHENOTYPES.items()}
            progress.update(task, description=f"body {number} of {count}")
            save_body(make_body(files[number - 1].stem, drawn), files[number - 1])
    return files
