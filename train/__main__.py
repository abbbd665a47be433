"""`python -m train METHOD --data DIR --out RUN`: fit a method to simulated sequences."""

import sys
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import tyro
from rich.console import Console
from tyro.conf import OmitArgPrefixes

from rasterize.command import run_command
from rasterize.errors import InputError
from train.loop import LOOPS, LoopConfig, check_run, fit
from train.physxnet import LOSSES, Losses, PhysXNetObjective
from uvcloth.bodies.body import load_body
from uvcloth.methods.physxnet import PRESETS, PhysXNetConfig


@dataclass(frozen=True)
class PhysXNetRun:
    """Train PhysXNet: body motion maps in, garment offset maps out."""

    data: Path
    """Folder of sequences made by `uvcloth simulate`."""
    out: Path
    """Folder of the run: checkpoint, training state, TensorBoard."""
    preset: str = "default"
    """default, paper or tiny: where every setting below starts from."""
    resume: bool = False
    """Continue the run in `out` where it stopped."""
    body: Path | None = None
    """The body that the sequences were simulated on; default: the one in the package."""
    network: OmitArgPrefixes[PhysXNetConfig] = field(default_factory=PhysXNetConfig)
    losses: OmitArgPrefixes[Losses] = field(default_factory=Losses)
    loop: OmitArgPrefixes[LoopConfig] = field(default_factory=LoopConfig)

    def objective(self) -> PhysXNetObjective:
        """Read the data and build what is trained."""
        return PhysXNetObjective(
            self.network, self.losses, self.data, self.out, load_body(self.body) if self.body else None
        )


def physxnet_preset(name: str) -> dict[str, Any]:
    """The settings of a preset, as defaults of PhysXNetRun. Raises InputError for an unknown name."""
    if name not in PRESETS:
        raise InputError(f"--preset {name}: expected one of {', '.join(PRESETS)}")
    return {"preset": name, "network": PRESETS[name], "losses": LOSSES[name], "loop": LOOPS[name]}


METHODS: dict[str, tuple[type[PhysXNetRun], Any]] = {"physxnet": (PhysXNetRun, physxnet_preset)}
"""What can be trained: its settings, and the presets they start from."""


def main() -> None:
    """Parse the command line and train."""
    method, *arguments = sys.argv[1:] or ["--help"]
    if method not in METHODS:
        if method in ("-h", "--help"):
            print(f"usage: python -m train {{{','.join(METHODS)}}} --data DIR --out RUN [--help]")
            return
        raise InputError(f"{method}: cannot be trained, expected one of {', '.join(METHODS)}")
    kind, preset = METHODS[method]
    default = replace(kind(data=tyro.MISSING, out=tyro.MISSING), **preset(_preset_of(arguments)))
    run = tyro.cli(kind, args=arguments, default=default, prog=f"python -m train {method}")
    if find_spec("lightning") is None:
        raise InputError("training needs Lightning: install uvcloth[train]")
    check_run(run.out, resume=run.resume)
    if run.network.history and run.loop.devices > 1:
        raise InputError("--history: what a network remembers is trained on one device, leave out --devices")
    errors = fit(run.objective(), run.out, run.loop, resume=run.resume)
    parts = ", ".join(f"{key} {value:.1f}" for key, value in errors.items() if key not in ("step", "minutes"))
    Console().print(f"{run.out}: best at step {errors['step']:.0f}, validation mm: {parts}")


def _preset_of(arguments: list[str]) -> str:
    for index, argument in enumerate(arguments):
        if argument == "--preset" and index + 1 < len(arguments):
            return arguments[index + 1]
        if argument.startswith("--preset="):
            return argument.partition("=")[2]
    return "default"


if __name__ == "__main__":
    sys.exit(run_command("train", main))
