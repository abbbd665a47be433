"""Kills of every command: `kill -9` at random moments, the command again, and the results compared.

Run from the checkout with PYTHONPATH=. on Linux as

    OMP_NUM_THREADS=1 python benchmarks/kills.py [--times 100] [--only simulate train-pbns ...] [--seed 0]

Each run is a fork of one process that has imported everything, so that a kill hits the work and not Python's
start. Inputs are made up and tiny, and `simulate` has an engine that computes next to nothing. The table of
docs/reports/2026-11_robustness.md comes from here.
"""

import importlib
import multiprocessing
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import dask
import tyro
from rich.console import Console
from rich.table import Table

import evaluate.__main__
import train.__main__
import uvcloth.cli
from tests.kills.engine import Following
from tests.kills.trial import PROGRAMS, Command, try_command
from tests.train.deepsd.conftest import OUTFITS
from tests.train.deepsd.outfits import save_outfits
from tests.train.simulated import database_of, save_clips
from train.deepsd import physics, validation
from uvcloth.bodies.body import load_body
from uvcloth.commands.run import outfits as make_outfits
from uvcloth.motion.lead_in import LeadIn
from uvcloth.motion.poses import save_poses
from uvcloth.process.command import run_command
from uvcloth.simulation import batch, unfinished
from uvcloth.simulation.engines import ENGINES

FORMATS = ("npz", "glb", "usdc", "abc", "pc2", "obj", "mp4", "gif", "png")
MOVING = ("--motion", "walk", "--frames", "0:4")


MODULES = {
    "rollout": (
        *("pxr.Usd", "pxr.UsdGeom", "pxr.UsdSkel", "alembic3d", "imath", "av"),
        "uvcloth.commands.run.rollout",
    ),
    "simulate": ("dask.distributed",),
    "poses": ("uvcloth.motion.draw_poses", "uvcloth.motion.recombine", "uvcloth.physics.self_contact"),
    "outfits": ("uvcloth.commands.run.outfits",),
    "export": ("pxr.Usd", "pxr.UsdGeom", "pxr.UsdSkel", "onnx", "uvcloth.commands.run.export"),
    "evaluate": (
        *("jinja2", "evaluate.compare", "evaluate.report", "evaluate.show", "evaluate.motion_map"),
        *("evaluate.selection", "evaluate.garment_space"),
    ),
    "train": (
        *("lightning_fabric", "tensorboard.summary.writer.event_file_writer", "torch.utils.tensorboard"),
        "lightning_fabric.loggers.tensorboard",
    ),
}
"""Modules that commands import, by the beginning of their names."""


def commands(inputs: Path) -> list[Command]:
    """Every command, on made-up inputs."""
    rollout = ("rollout", *MOVING, "--garment", "tops", "--model", "lbs")
    poses, clips, moved = (str(inputs / name) for name in ("poses.npz", "clips", "outfits"))
    tiny = ("--preset", "tiny", "--save-seconds", "0.1", "--out", "OUT")
    resume, one, pair = ("--resume",), ("--jobs", "1"), ("--jobs", "2")
    return [
        *(
            Command(f"rollout-{kind}", "uvcloth", (*rollout, "--finish", "none", "--out", f"OUT/a.{kind}"))
            for kind in FORMATS
        ),
        Command("rollout-four", "uvcloth", (*rollout, "--out", *(f"OUT/a.{kind}" for kind in FORMATS[:4]))),
        Command(
            "simulate", "uvcloth",
            # Two workers that are forked, not spawned as otherwise, inherit one another's pipes.
            ("simulate", "walk", "--frames", "0:20", "--garment", "tops", "bottoms", *one, "--out", "OUT"),
            indifferent=pair,
        ),
        Command(
            "poses", "uvcloth", ("poses", "walk", "--every", "12", "--recombine", "4", "--out", "OUT/p.npz")
        ),
        Command(
            "outfits", "uvcloth",
            ("outfits", "--count", "2", "--body", "builtin", "--type", "skirt", *pair, "--out", "OUT"),
            indifferent=one,
        ),
        Command("export-glb", "uvcloth", ("export", "--model", "pbns", *MOVING, "--out", "OUT/r.glb")),
        Command("export-usdc", "uvcloth", ("export", "--model", "pbns", *MOVING, "--out", "OUT/r.usdc")),
        Command("export-onnx", "uvcloth", ("export", "--model", "pbns", "--out", "OUT/r.glb")),
        Command(
            "evaluate", "evaluate",
            ("--model", "lbs", "--data", clips, "--frames", "2", "--no-pictures", "--map-size", "16", "--out",
             "OUT"),
            "scores",
        ),
        Command(
            "train-physxnet", "train",
            ("physxnet", "--data", clips, "--templates", "tops", "bottoms", *tiny), "weights", resume,
        ),
        Command(
            "train-motion_guided", "train",
            ("motion_guided", "--data", clips, "--garment", "tops", *tiny), "weights", resume,
        ),
        Command(
            "train-pbns", "train", ("pbns", "--garment", "tops", "--poses", poses, *tiny), "weights", resume
        ),
        Command("train-deepsd", "train", ("deepsd", "--data", moved, *tiny), "weights", resume),
    ]  # fmt: skip


def make_inputs(folder: Path) -> None:
    """Write what the commands read."""
    save_clips(folder / "clips", ("tops", "bottoms"), clips=2, frames=14)
    save_outfits(folder / "outfits", OUTFITS)
    save_poses(database_of(load_body()), folder / "poses.npz")


def prepare(names: Sequence[str]) -> None:
    """Import what commands of these names need, and make their fixed costs small; starts no thread."""
    for beginning, modules in MODULES.items():
        if any(name.startswith(beginning) for name in names):
            for module in modules:
                importlib.import_module(module)
    # A new process would import all of this once more.
    dask.config.set({"distributed.worker.multiprocessing-method": "fork"})
    vars(make_outfits)["get_context"] = lambda method: multiprocessing.get_context("fork")
    batch.LEAD_IN = LeadIn(rest=1, blend=1, ramp=1)
    unfinished.SECONDS = 0.1
    ENGINES["explicit"] = Following
    validation.POSES = vars(physics)["POSES"] = 2
    PROGRAMS.update(
        uvcloth=uvcloth.cli.main,
        train=lambda: run_command("train", train.__main__.main),
        evaluate=evaluate.__main__.main,
    )


@dataclass(frozen=True)
class Kills:
    """Kill commands at random moments, run them again, and compare."""

    times: int = 100
    """Kills of each command."""
    only: tuple[str, ...] = ()
    """Of these commands alone."""
    seed: int = 0
    """Decides the moments."""

    def run(self) -> int:
        """Run and print the table; returns 1 if anything is wrong."""
        table = Table("command", "s", "kills", "left hidden by the kill", "wrong", title=f"seed {self.seed}")
        faults: list[str] = []
        with tempfile.TemporaryDirectory(prefix="uvcloth-kills-") as place:
            folder = Path(place)
            wanted = [each for each in commands(folder) if not self.only or each.name in self.only]
            prepare([command.name for command in wanted])
            if any(str(folder) in word for command in wanted for word in command.words):
                make_inputs(folder)
            for command in wanted:
                tally = try_command(command, self.times, folder, self.seed)
                faults += [f"{command.name}: {fault}" for fault in tally.faults]
                row = (command.name, f"{tally.seconds:.1f}", tally.kills, tally.leftovers, len(tally.faults))
                table.add_row(*map(str, row))
                print(*row, *tally.faults, sep="\t", file=sys.stderr, flush=True)
        Console(width=100).print(table, *faults, sep="\n")
        return bool(faults)


if __name__ == "__main__":
    sys.exit(tyro.cli(Kills).run())
