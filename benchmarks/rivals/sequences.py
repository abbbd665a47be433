"""The sequences of a data folder whose motion a rival gets, and the files that it writes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from torch import Tensor

from uvcloth.motion.index import INDEX, read_index


@dataclass(frozen=True)
class RivalRun:
    """What every rival is asked to simulate."""

    data: tyro.conf.Positional[Path]
    """Folder of sequences, whose motion and garments are used."""
    out: tyro.conf.Positional[Path]
    """Folder for CLIP_GARMENT.npz."""
    garments: tuple[str, ...] = ("tops", "bottoms", "dress")
    """Garments to simulate."""
    split: Literal["train", "validation", "test"] = "validation"
    """Clips to simulate, by the index of the data folder."""
    quality: Literal["fast", "default", "fine", "mesh"] = "default"
    """Cage, or the garment's own mesh."""

    def write(self, name: str, vertices: Tensor, fps: float, ms: float, count: int) -> None:
        """Write a garment's frames (F, N, 3) m, as `--predicted` reads them, and say what a frame took.

        ms: milliseconds of processor time. count: vertices that were simulated.
        """
        np.savez_compressed(self.out / name, vertices=vertices.numpy(), fps=fps, ms_per_frame=ms)
        print(f"{Path(name).stem}: {count} vertices, {ms:.1f} ms of processor time a frame", flush=True)


def sequences(data: Path, garment: str, split: str) -> list[Path]:
    """The files of a garment in a split of a data folder, on its usual body.

    Raises InputError as `read_index`.
    """
    entries = read_index(data / INDEX).values()
    paths = [data / f"{each.clip}_{garment}.npz" for each in entries if each.split == split]
    return [path for path in paths if path.is_file()]
