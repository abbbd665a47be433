"""Which ideas of the default PhysXNet earn their place: one-line changes, trained equally long.

Run from the checkout as

    python benchmarks/ablation.py --data DATA --out RUNS [--steps 600] [--only default "no mirroring"]

Finished runs are kept, so that it can be interrupted; another length or other data need another folder. It
prints a table in Markdown: the best mean vertex error in mm over the held-out clips, per template, as
decoded, and how long a step took, validation included.
"""

import os
import subprocess
import sys
from pathlib import Path

import tyro

from rasterize.command import run_command
from rasterize.errors import InputError
from uvcloth.checkpoint import load_checkpoint

VARIANTS: dict[str, tuple[str, ...]] = {
    "default": (),
    "velocity and acceleration only": ("--no-pose",),
    "plain acceleration": ("--acceleration", "plain"),
    "world axes": ("--frame", "world"),
    "offsets from the body": ("--anchor", "body"),
    "offsets from the middle of the channel": ("--centre", "channel"),
    "channels scaled to [-1, 1]": ("--scaling", "min_max"),
    "inputs of any size": ("--reach", "0"),
    "no mirroring": ("--no-mirror",),
    "no edge and bend losses": ("--edge", "0", "--bend", "0"),
    "no memory": ("--history", "0"),
    "adversarial": ("--adversarial",),
    "batch normalization": ("--norm", "batch"),
    "transposed convolutions": ("--upsample", "transposed"),
    "maps of 128": ("--size", "128"),
    "no dropout": ("--dropout", "0"),
    "four levels": ("--levels", "4"),
    "the paper's choices": ("--preset", "paper", "--size", "64", "--width", "32"),
}
"""The changes, as arguments of `python -m train physxnet`."""


def main(
    data: Path,
    out: Path,
    steps: int = 600,
    only: tuple[str, ...] = tuple(VARIANTS),
) -> None:
    """Train every variant and print the table. Raises InputError for an unknown variant."""
    for name in only:
        if name not in VARIANTS:
            raise InputError(f"--only {name!r}: expected some of {', '.join(VARIANTS)}")
    rows = []
    for name in only:
        run = out / name.replace(" ", "_").replace("[", "").replace("]", "").replace(",", "")
        finished = run / "finished"
        if not finished.exists():
            resume = ["--resume"] if (run / "training").exists() else []
            settings = ["--steps", str(steps), "--validate-every", str(steps // 4)]
            command = [sys.executable, "-m", "train", "physxnet", "--data", str(data), "--out", str(run)]
            print(f"{name}:", *VARIANTS[name], file=sys.stderr)
            subprocess.run(
                [*command, *settings, *VARIANTS[name], *resume],
                check=True,
                env={**os.environ, "PYTHONPATH": "."},
            )
            finished.touch()
        rows.append((name, load_checkpoint(run).notes))
    templates = [key for key in rows[0][1]["validation"] if key != "mean_mm"]
    print("| variant | change | mean | " + " | ".join(templates) + " | ms/step |")
    print("|---|---|" + "---:|" * (len(templates) + 2))
    for name, notes in rows:
        errors = notes["validation"]
        values = [f"{errors[key]:.1f}" for key in ("mean_mm", *templates)]
        change = " ".join(VARIANTS[name])
        pace = 60000 * notes["minutes"] / notes["step"]
        print(f"| {name} | `{change}` | " + " | ".join(values) + f" | {pace:.0f} |")


if __name__ == "__main__":
    sys.exit(run_command("ablation", lambda: tyro.cli(main)))
