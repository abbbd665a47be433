"""Which ideas of a method's default settings earn their place: one-line changes, trained equally long.

Run from the checkout as

    python benchmarks/ablation.py --method physxnet --data DATA ... --out RUNS [--steps 600]
        [--only default "no mirroring"]

Finished runs are kept, so that it can be interrupted; another length or other data need another folder. It
prints a table in Markdown: the validation scores of the network that was kept, the first of which it was
chosen by, and how long a step took, validation included.
"""

import os
import subprocess
import sys
from pathlib import Path
from typing import Literal

import tyro

from uvcloth.checkpoint import load_checkpoint
from uvcloth.errors import InputError
from uvcloth.process.command import run_command

PHYSXNET: dict[str, tuple[str, ...]] = {
    "default": (),
    "velocity and acceleration only": ("--no-pose",),
    "pose only": ("--no-motion",),
    "plain acceleration": ("--acceleration", "plain"),
    "world axes": ("--frame", "world"),
    "offsets from the body": ("--anchor", "body"),
    "offsets from the middle of the channel": ("--centre", "channel"),
    "channels scaled to [-1, 1]": ("--scaling", "min_max"),
    "inputs of any size": ("--reach", "0"),
    "no mirroring": ("--no-mirror",),
    "no edge and bend losses": ("--edge", "0", "--bend", "0"),
    "memory of two maps": ("--history", "2"),
    "adversarial": ("--adversarial",),
    "batch normalization": ("--norm", "batch"),
    "transposed convolutions": ("--upsample", "transposed"),
    "maps of 128": ("--size", "128"),
    "dropout": ("--dropout", "0.4"),
    "three levels": ("--levels", "3"),
    "the paper's choices": ("--preset", "paper", "--size", "64", "--width", "32"),
}

OFFSETS = ("--deformation", "offsets", "--points", "0.1")
GLOBAL = ("--global-layers", "256")
LITE = ("--convolutions", "32", "64", "64", "64", "--global-layers", "64")

DEEPSD: dict[str, tuple[str, ...]] = {
    "default": (),
    "global descriptor": GLOBAL,
    "offsets, no global descriptor": OFFSETS,
    "offsets": (*OFFSETS, *GLOBAL),
    "offsets, smaller descriptors": (*OFFSETS, *LITE),
    "offsets, graph convolutions after the descriptor": (*OFFSETS, *GLOBAL, "--graph-heads"),
    "offsets, three layers before pooling": (*OFFSETS, "--global-layers", "256", "256", "256"),
    "pose as keys": ("--keys", "0"),
    "no blend shapes": ("--deformation", "none", "--blend-weights", "changed"),
    "mesh alone": ("--inputs", "mesh"),
    "blend weights as a change of the smooth ones": ("--blend-weights", "changed"),
    "blend weights from nothing": ("--blend-weights", "learned", "--closest-weights", "100"),
    "fabrics not told": ("--no-reads-fabric",),
    "all joints seen": ("--seen-joints", "0"),
    "all joints seen in every pose": ("--pose-dropout", "0"),
    "metres and radians": ("--no-standardized",),
    "all joints move a vertex": ("--influences", "99"),
    "convolutions over neighbours, not a distance": ("--spread", "0"),
    "no mirroring": ("--no-mirror",),
    "squared error": ("--error", "squared"),
    "edges as they may be": ("--edges", "0"),
    "edges kept more": ("--edges", "10"),
    "the paper's network": ("--inputs", "mesh", "--blend-weights", "learned", "--influences", "99",
                            "--closest-weights", "100", "--spread", "0", *GLOBAL, "--no-reads-fabric",
                            "--seen-joints", "0", "--pose-dropout", "0", "--no-standardized",
                            "--small-shapes", "1", "--edges", "0", "--pose-layers", "256", "256", "256"),
}  # fmt: skip
"""The rows of the paper's Tables 1 and 6, and what ours has of its own."""

VARIANTS: dict[str, dict[str, tuple[str, ...]]] = {"physxnet": PHYSXNET, "deepsd": DEEPSD}
"""The changes by method, as arguments of `uvcloth train`."""


def main(
    data: tuple[Path, ...],
    out: Path,
    method: Literal["physxnet", "deepsd"] = "physxnet",
    steps: int = 600,
    only: tuple[str, ...] = (),
) -> None:
    """Train every variant and print the table. Raises InputError for an unknown variant."""
    variants = VARIANTS[method]
    for name in only:
        if name not in variants:
            raise InputError(f"--only {name!r}: expected some of {', '.join(variants)}")
    rows = []
    for name in only or variants:
        run = out / name.replace(" ", "_").replace("[", "").replace("]", "").replace(",", "")
        finished = run / "finished"
        if not finished.exists():
            resume = ["--resume"] if (run / "training").exists() else []
            settings = ["--steps", str(steps), "--validate-every", str(steps // 4)]
            command = [sys.executable, "-m", "train", method, "--data", *map(str, data), "--out", str(run)]
            print(f"{name}:", *variants[name], file=sys.stderr)
            subprocess.run(
                [*command, *settings, *variants[name], *resume],
                check=True,
                env={**os.environ, "PYTHONPATH": "."},
            )
            finished.touch()
        rows.append((name, load_checkpoint(run).notes))
    scores = list(rows[0][1]["validation"])
    print("| variant | change | " + " | ".join(scores) + " | ms/step |")
    print("|---|---|" + "---:|" * (len(scores) + 1))
    for name, notes in rows:
        values = [f"{notes['validation'][key]:.3g}" for key in scores]
        change = " ".join(variants[name])
        pace = 60000 * notes["minutes"] / notes["step"]
        print(f"| {name} | `{change}` | " + " | ".join(values) + f" | {pace:.0f} |")


if __name__ == "__main__":
    sys.exit(run_command("ablation", lambda: tyro.cli(main)))
