"""Sizes of packed sequences, and how far their vertices are from the simulated ones, by garment and error.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/packs.py --data DATA [--errors 0.5 1 2] [--before PACKED]

DATA is a folder of sequences as they were simulated: unpacked ones are of numbers that were rounded once. It
prints kilobytes of 90 frames, warm-up frames among them, without the motion and the mesh, whose own sizes
stand below, and distances over all frames. --before: a folder of the same sequences that another version
packed.
"""

import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from uvcloth.dataset.clip_file import load_simulated
from uvcloth.dataset.packed import PackedFolder, load_packed, pack_folder

FRAMES = 90


def judged(data: Path, packed: Path) -> dict[str, tuple[int, float, float, np.ndarray]]:
    """Sequences, bytes, frames and distances, mm, (F, N) in one, of the packed ones of each garment."""
    shared = PackedFolder(packed)
    sums: dict[str, list[tuple[int, int, np.ndarray]]] = defaultdict(list)
    for path in sorted(packed.glob("*.npz")):
        before, after = load_simulated(data / path.name), load_packed(path, shared)
        off = 1e3 * (before.vertices - after.vertices).norm(dim=-1).numpy()
        sums[before.garments[0].name].append((path.stat().st_size, len(off), off.reshape(-1)))
    return {
        garment: (len(rows), sum(row[0] for row in rows), sum(row[1] for row in rows), flattened(rows))
        for garment, rows in sums.items()
    }


def flattened(rows: list[tuple[int, int, np.ndarray]]) -> np.ndarray:
    """The distances of all rows, one after another."""
    return np.concatenate([row[2] for row in rows])


def folders(
    data: Path, errors: tuple[float, ...], before: Path | None, work: Path
) -> Iterator[tuple[str, Path]]:
    """Yield packed folders of the data, each with what it is called."""
    if before is not None:
        yield "before", before
    for error in errors:
        pack_folder(data, work / f"{error:g}", 1e-3 * error)
        yield f"{error:g} mm", work / f"{error:g}"


def main(data: Path, errors: tuple[float, ...] = (0.5, 1.0, 2.0), before: Path | None = None) -> None:
    """Print sizes and distances of the sequences of a folder."""
    table = Table(
        "packed", "garment", "sequences", "frames", "kB of 90 frames", "mean mm", "99 % mm", "max mm"
    )
    lines = []
    with tempfile.TemporaryDirectory() as work:
        for name, packed in folders(data, errors, before, Path(work)):
            for garment, (count, size, frames, off) in judged(data, packed).items():
                figures = off.mean(), np.percentile(off, 99), off.max()
                kilobytes = f"{size / frames * FRAMES / 1e3:.1f}"
                row = (str(count), f"{frames:.0f}", kilobytes, *(f"{figure:.2f}" for figure in figures))
                table.add_row(name, garment, *row)
            parts = ("motions", "meshes", "bodies")
            sizes = {part: [path.stat().st_size for path in (packed / part).glob("*.npz")] for part in parts}
            shared = ", ".join(f"{len(s)} {part} {sum(s) / 1e3:.0f} kB" for part, s in sizes.items() if s)
            whole = sum(path.stat().st_size for path in packed.rglob("*.npz"))
            lines.append(f"{name}: {shared}, in all {whole / 1e3:.0f} kB")
    Console().print(table, *lines, sep="\n")


if __name__ == "__main__":
    tyro.cli(main)
