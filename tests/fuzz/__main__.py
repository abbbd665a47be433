"""`python -m tests.fuzz`: thousands of mutated files for every reader, and a table."""

import argparse
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.fuzz.registry import TARGETS
from tests.fuzz.runner import Tally, replay, try_reader

KINDS = ("read", "refused", "contradiction", "sentence", "exception", "hang", "memory", "crash")


def main() -> int:
    """Try readers, or one case again; returns the exit code: 1 if any reader failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000, help="cases of each reader")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--only", nargs="+", choices=sorted(TARGETS), default=sorted(TARGETS), metavar="READER"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("fuzz"), help="folder for the files of failing cases"
    )
    parser.add_argument("--replay", metavar="READER:NUMBER", help="one case again, with its traceback")
    options = parser.parse_args()
    if options.replay:
        return _replay(options.replay, options.seed, options.out)
    console, tallies = Console(width=120), []
    numbers = range(options.first, options.first + options.cases)
    try:
        with Progress(console=console) as progress:
            for name in options.only:
                bar = progress.add_task(name, total=len(numbers))
                tally = Tally(name)
                tallies.append(tally)

                def show(tally: Tally, bar=bar) -> None:
                    tallies[-1] = tally
                    failed = f" [red]{len(tally.failures)} failed" if tally.failures else ""
                    progress.update(bar, advance=1, description=tally.name + failed)

                tallies[-1] = try_reader(TARGETS[name], numbers, options.seed, options.out, show)
    except KeyboardInterrupt:
        console.print("interrupted; the last reader is not whole")
    console.print(_table(tallies))
    for tally in tallies:
        for number, words, outcome in tally.failures[:5]:
            place = f"{tally.name}:{number}"
            console.print(f"{place} {outcome.kind}: {outcome.words[:200]}\n    {words[:200]}", markup=False)
    return int(any(tally.failures for tally in tallies))


def _table(tallies: list[Tally]) -> Table:
    table = Table(title="Cases by outcome; s of CPU and MB of the worst case")
    for column in ("reader", "cases", *KINDS, "s", "MB"):
        table.add_column(column, justify="left" if column == "reader" else "right")
    for tally in tallies:
        counts = [str(tally.kinds[kind]) for kind in KINDS]
        table.add_row(
            tally.name, str(tally.kinds.total()), *counts, f"{tally.seconds:.2f}", f"{tally.megabytes:.0f}"
        )
    return table


def _replay(case: str, seed: int, out: Path) -> int:
    name, _, number = case.partition(":")
    path, words, outcome = replay(TARGETS[name], int(number), seed, out / f"{name}-{seed}-{number}")
    print(f"{path}\n{words}\n{outcome.kind}: {outcome.words}\n{outcome.details}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
