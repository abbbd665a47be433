"""How far apart two engines are: the same clips and garments simulated into two folders.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/engines.py --ours DATA --other DATA_OF_ANOTHER_ENGINE

Prints per garment the mean distance between the vertices of the two, mm, over the scored frames in both,
and beside it how far each engine is from its own repeats (DATA/repeat, made by `uvcloth simulate --repeat`):
no error of a method below these distances means much.
"""

import sys
from collections.abc import Iterable
from pathlib import Path

import torch
import tyro
from rich.console import Console
from rich.table import Table
from torch import Tensor

from rasterize.command import run_command
from rasterize.errors import InputError
from uvcloth.simulate.sequence import MOTION_TOLERANCE, load_sequence


def apart(first: Path, second: Path) -> tuple[str, Tensor]:
    """The garment, and the mean distance of two simulations of one motion at each frame of both (F,), m.

    Their last frames are the same one. Raises InputError for other meshes or motions.
    """
    ours, other = load_sequence(first), load_sequence(second)
    frames = min(len(each.vertices) - each.warm_up for each in (ours, other))
    if ours.vertices.shape[1:] != other.vertices.shape[1:]:
        raise InputError(f"{second}: not the mesh of {first}")
    if float((ours.transforms[-frames:] - other.transforms[-frames:]).abs().max()) > MOTION_TOLERANCE:
        raise InputError(f"{second}: does not have the motion of {first}")
    return ours.garment, (ours.vertices[-frames:] - other.vertices[-frames:]).norm(dim=-1).mean(1)


def distances(ours: Path, other: Path) -> dict[str, list[Tensor]]:
    """Per garment, of each sequence that is in both folders, the distance at every frame."""
    found: dict[str, list[Tensor]] = {}
    for path in sorted(ours.glob("*.npz")):
        if (other / path.name).is_file():
            garment, distance = apart(path, other / path.name)
            found.setdefault(garment, []).append(distance)
    return found


def main(ours: Path, other: Path) -> None:
    """Print the table. Raises InputError if the folders share no sequence."""
    between = distances(ours, other)
    if not between:
        raise InputError(f"{other}: has no sequence of a clip and garment that {ours} has")
    repeats = [distances(folder, folder / "repeat") for folder in (ours, other)]
    engines = [_engine(folder) for folder in (ours, other)]
    table = Table("garment", "sequences", "frames", " against ".join(engines) + ", mm")
    for engine in engines:
        table.add_column(f"{engine} repeated, mm")
    for garment, found in between.items():
        table.add_row(
            garment,
            str(len(found)),
            str(sum(map(len, found))),
            *(_mean_mm(each) for each in (found, *(repeat.get(garment, []) for repeat in repeats))),
        )
    Console().print(table)


def _engine(folder: Path) -> str:
    return str(load_sequence(min(folder.glob("*.npz"))).metadata.get("engine", folder.name))


def _mean_mm(found: Iterable[Tensor]) -> str:
    """Every frame counts the same."""
    every = list(found)
    return f"{1e3 * float(torch.cat(every).mean()):.1f}" if every else "-"


if __name__ == "__main__":
    sys.exit(run_command("engines", lambda: tyro.cli(main)))
