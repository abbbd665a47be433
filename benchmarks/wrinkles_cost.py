"""Processor time of a frame of a T-shirt: cages, and wrinkles; one thread.

    python benchmarks/wrinkles_cost.py RUN

RUN: made by `train.wrinkles.tracked_runs`. Figures are ms, the least of ROUNDS means: neighbours on the same
core only lengthen them.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
import tyro
from rich.console import Console
from timing import fastest

from train.wrinkles.tracked_runs import load_run
from uvcloth.bodies.body import load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.process.command import run_command
from uvcloth.rollouts.rollout import PreparedRollout, prepare_rollout
from uvcloth.wrinkles.model import SHIPPED, load_wrinkles
from uvcloth.wrinkles.outfit import WrinkledOutfit

ROUNDS = 5


@torch.no_grad()
def main(run: tyro.conf.Positional[Path], model: Path = SHIPPED / "tops") -> None:
    """Print the table."""
    torch.set_num_threads(1)
    console, tracked = Console(), load_run(run)
    body = load_body()
    garment = load_garment("tops", body)
    outfit = Outfit(body, (garment,))

    def shown(name: str, act: Callable[[], Any], frames: int) -> None:
        spent = 1000.0 * fastest(act, ROUNDS, time.process_time) / frames
        console.print(f"| {name} | {spent:.1f} |", soft_wrap=True)

    motion = tracked.transforms.double()
    for quality in QUALITIES:
        prepared = prepare_rollout(Physics(PhysicsConfig(quality)), outfit)

        def moved(prepared: PreparedRollout = prepared) -> None:
            list(prepared.frames(motion, tracked.fps, keep_going=True))

        shown(f"cage of the quality {quality}", moved, len(tracked))
    wrinkles = load_wrinkles(model)
    posed, coarse = posed_skin(body, tracked.transforms), tracked.coarse[2:]
    dressed = WrinkledOutfit(wrinkles, outfit, [garment.mesh], wrinkles.config.quality)

    def wrinkled() -> None:
        dressed.begin()
        for vertices, skin in zip(coarse, posed, strict=True):
            dressed.shown((vertices,), skin, tracked.fps)

    shown("wrinkles", wrinkled, len(tracked))


if __name__ == "__main__":
    sys.exit(run_command("wrinkles_cost.py", lambda: tyro.cli(main)))
