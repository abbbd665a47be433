"""`uvcloth train METHOD --out RUN`: fit a method to simulated sequences, or PBNS to physics alone.

In a checkout `python -m train` is the same.
"""

import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import MISSING, fields, replace
from importlib.util import find_spec
from typing import Any

import tyro
from rich.console import Console

from uvcloth.errors import InputError
from uvcloth.files.atomic import sole_writer
from uvcloth.files.options import parsed
from uvcloth.process.command import run_command

from .registry import TRAINERS, trainer
from .trainer import TrainingRun


def parse(method: str, arguments: Sequence[str]) -> TrainingRun:
    """Parse the command line after the name of a method.

    Raises InputError for an unknown method or an option out of its range, and SystemExit as
    `uvcloth.cli.parse`.
    """
    if method not in TRAINERS:
        raise InputError(f"{method}: cannot be trained, expected one of {', '.join(TRAINERS)}")
    entry = trainer(method)
    default = starting_from(entry.run, entry.presets, _preset_of(arguments))

    def run() -> TrainingRun:
        return tyro.cli(entry.run, args=arguments, default=default, prog=f"uvcloth train {method}")

    return parsed(run, arguments)


def main() -> None:
    """Parse the command line of the process and train."""
    run(sys.argv[1:])


def run(words: Sequence[str]) -> None:
    """Parse a command line and train. Raises as `parse`, and InputError for data that do not serve."""
    method, *arguments = words or ["--help"]
    if method in ("-h", "--help"):
        print(f"usage: uvcloth train {{{','.join(TRAINERS)}}} --out RUN [--help]")
        return
    training = parse(method, arguments)
    if find_spec("lightning_fabric") is None:
        raise InputError("training needs Lightning: install uvcloth[train]")
    # Of several processes that Lightning starts for one run, the first claims its folder.
    ranks = ("LOCAL_RANK", "NODE_RANK", "GROUP_RANK")
    first = all(os.environ.get(rank, "0") == "0" for rank in ranks)
    with sole_writer(training.out) if first else nullcontext():
        scores = training.train()
    from .loop import format_scores

    kept = f"kept that of step {scores['step']:.0f}, validation: {format_scores(scores)}"
    Console().print(f"{training.out}: {kept}")


def starting_from(
    kind: type[TrainingRun], presets: Mapping[str, Mapping[str, Any]], name: str | None
) -> TrainingRun:
    """A run with the settings of a preset, by default the first one; settings without a default stay missing.

    Raises InputError for an unknown name.
    """
    parts: tuple[Any, ...] = fields(kind)  # type: ignore[arg-type]
    needed = [part.name for part in parts if part.default is part.default_factory is MISSING]
    missing: Any = {part: tyro.MISSING for part in needed}
    if not presets:
        return kind(**missing)
    preset = name or next(iter(presets))
    if preset not in presets:
        raise InputError(f"--preset {preset}: expected one of {', '.join(presets)}")
    return replace(kind(**missing), preset=preset, **presets[preset])  # type: ignore[type-var]


def _preset_of(arguments: Sequence[str]) -> str | None:
    """The preset named on the command line, None for none."""
    for index, argument in enumerate(arguments):
        if argument == "--preset" and index + 1 < len(arguments):
            return arguments[index + 1]
        if argument.startswith("--preset="):
            return argument.partition("=")[2]
    return None


if __name__ == "__main__":
    sys.exit(run_command("train", main))
