"""The solver of `physics` on cages of another edge length over the windows of a data folder.

    PYTHONPATH=. python benchmarks/rivals/cage_sizes.py DATA OUT --edge 0.08

OUT is for `--predicted cage=OUT`, beside the qualities fast, default and fine, which are methods. The
milliseconds are processor time.
"""

import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch
import tyro

from benchmarks.rivals.sequences import sequences
from uvcloth.bodies.body import load_body
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.files.atomic import make_folder
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.process.command import run_command
from uvcloth.rollouts.rollout import prepare_rollout


@dataclass(frozen=True)
class CageSizes:
    """Roll windows out on cages of an edge length."""

    data: tyro.conf.Positional[Path]
    """Folder of sequences, whose motion and garments are used."""
    out: tyro.conf.Positional[Path]
    """Folder for CLIP_GARMENT.npz."""
    edge: float
    """Edge length, m."""
    garments: tuple[str, ...] = ("tops", "bottoms", "dress")
    """Garments to roll out."""
    split: Literal["train", "validation", "test"] = "validation"
    """Clips to roll out, by the index of the data folder."""

    def run(self) -> None:
        """Roll out. Raises InputError for a damaged sequence."""
        torch.set_grad_enabled(False)
        torch.set_num_threads(1)
        name = f"{self.edge} m"
        QUALITIES[name] = self.edge
        method = Physics(PhysicsConfig(name))
        body = load_body()
        make_folder(self.out)
        for garment in self.garments:
            outfit = Outfit(body, (load_garment(garment, body),))
            prepared = replace(prepare_rollout(method, outfit), clock=time.process_time)
            for path in sequences(self.data, garment, self.split):
                clip = load_simulated(path)
                frames = list(prepared.frames(clip.transforms, clip.fps))
                ms = float(np.mean([frame.milliseconds["network"] for frame in frames]))
                vertices = torch.cat([frame.raw[0][None] for frame in frames]).numpy()
                np.savez_compressed(self.out / path.name, vertices=vertices, fps=clip.fps, ms_per_frame=ms)
                print(f"{path.stem}: {len(prepared.prepared.hold)} vertices, {ms:.1f} ms", flush=True)


if __name__ == "__main__":
    sys.exit(run_command("cage_sizes.py", lambda: tyro.cli(CageSizes).run()))
