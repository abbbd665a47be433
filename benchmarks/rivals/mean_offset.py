"""The mean offset of training, for `--predicted mean=OUT`: any model has to be better.

    PYTHONPATH=. python benchmarks/rivals/mean_offset.py DATA OUT [--garments dress] [--windows DATA]

Each vertex of a garment keeps its mean offset from the smoothly skinned garment over the training clips of
DATA, in the axes that skinning turns. OUT/CLIP_GARMENT.npz is written for each validation window.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
import tyro
from torch import Tensor

from benchmarks.rivals.sequences import sequences
from uvcloth.bodies.body import load_body
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.errors import InputError
from uvcloth.files.atomic import make_folder
from uvcloth.garments.garment import Garment
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.rotations import rotate, rotate_back
from uvcloth.geometry.skinning import skin_frames
from uvcloth.process.command import run_command

STRIDE = 5
"""Frames of training from one that counts to the next."""


@dataclass(frozen=True)
class MeanOffset:
    """Predict the mean offset of training."""

    data: tyro.conf.Positional[Path]
    """Folder of the sequences to learn from."""
    out: tyro.conf.Positional[Path]
    """Folder for CLIP_GARMENT.npz."""
    windows: Path | None = None
    """Folder of the sequences to predict, DATA without one."""
    garments: tuple[str, ...] = ("tops", "bottoms", "dress")
    """Garments to predict."""
    split: Literal["validation", "test"] = "validation"
    """Clips to predict."""

    def run(self) -> None:
        """Learn and predict. Raises InputError if there is nothing to learn from."""
        torch.set_grad_enabled(False)
        body = load_body()
        make_folder(self.out)
        for name in self.garments:
            garment = load_garment(name, body)
            learned = sequences(self.data, name, "train")
            if not learned:
                raise InputError(f"{self.data}: holds no training sequence of {name}")
            mean = mean_offset(garment, learned)
            print(f"{name}: learned from {len(learned)} clips, {1000 * mean.norm(dim=1).mean():.1f} mm")
            for path in sequences(self.windows or self.data, name, self.split):
                clip = load_simulated(path)
                origins, axes = skin_frames(garment.mesh.vertices, garment.smooth_weights, clip.transforms)
                vertices = (origins + rotate(axes, mean.expand_as(origins))).numpy()
                np.savez_compressed(self.out / path.name, vertices=vertices, fps=clip.fps)


def mean_offset(garment: Garment, paths: list[Path]) -> Tensor:
    """Mean offset (N, 3) m from the skinned garment in its local axes, over the frames of sequences."""
    total, count = torch.zeros(len(garment.mesh.vertices), 3), 0
    for path in paths:
        clip = load_simulated(path)
        frames = slice(clip.warm_up, None, STRIDE)
        origins, axes = skin_frames(garment.mesh.vertices, garment.smooth_weights, clip.transforms[frames])
        offsets = rotate_back(axes, clip.vertices[frames] - origins)
        total, count = total + offsets.sum(0), count + len(offsets)
    return total / count


if __name__ == "__main__":
    sys.exit(run_command("mean_offset.py", lambda: tyro.cli(MeanOffset).run()))
