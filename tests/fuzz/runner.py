"""Running of cases: the outcomes of one reader counted, its failures kept."""

import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.fuzz.case import Corpus
from tests.fuzz.target import Target
from tests.fuzz.worker import FINE, Outcome, Worker, judge

MEMORY_DISK = Path("/dev/shm")
"""Folder of a disk in memory, where there is one: cases are many small files."""


@dataclass
class Tally:
    """Outcomes of one reader so far.

    kinds: how many cases ended in each kind of outcome. seconds: of CPU of the slowest case. megabytes: of
    the largest. failures: case, what was done to the file, and outcome.
    """

    name: str
    kinds: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    megabytes: float = 0.0
    failures: list[tuple[int, str, Outcome]] = field(default_factory=list)

    def add(self, number: int, words: str, outcome: Outcome) -> None:
        """Count one case."""
        self.kinds[outcome.kind] += 1
        self.seconds = max(self.seconds, outcome.seconds)
        self.megabytes = max(self.megabytes, outcome.megabytes)
        if outcome.kind not in FINE:
            self.failures.append((number, words, outcome))


def try_reader(
    target: Target,
    numbers: Iterable[int],
    seed: int = 0,
    keep: Path | None = None,
    progress: Callable[[Tally], None] = lambda tally: None,
) -> Tally:
    """Try the cases of some numbers.

    keep: folder for the files of cases that fail, TARGET-SEED-NUMBER each with its outcome.txt.
    Raises what reader or check raise where they fail on the files as they are.
    """
    tally = Tally(target.name)
    place = MEMORY_DISK if MEMORY_DISK.is_dir() else None
    with TemporaryDirectory(prefix="fuzz", dir=place) as folder, Worker(target) as worker:
        corpus = Corpus(target, Path(folder))
        # Here, before the worker is forked, so that what they import late is imported once.
        target.check(target.read(corpus.copy(Path(folder) / "case")))
        for number in numbers:
            case = Path(folder) / "case"
            path, words = corpus.case(seed, number, case)
            outcome = worker.judge(path)
            tally.add(number, words, outcome)
            if outcome.kind not in FINE and keep is not None:
                _keep(case, keep / f"{target.name}-{seed}-{number}", words, outcome)
            progress(tally)
    return tally


def replay(target: Target, number: int, seed: int, folder: Path) -> tuple[Path, str, Outcome]:
    """Make one case in a folder and read it in this process, without limits: path, words, outcome."""
    with TemporaryDirectory(prefix="fuzz") as temporary:
        path, words = Corpus(target, Path(temporary)).case(seed, number, folder)
    return path, words, judge(target, path)


def _copy(source: str, target: str) -> None:
    """Copy a file, or make a pipe like it."""
    if Path(source).is_fifo():
        os.mkfifo(target)
    else:
        shutil.copy2(source, target)


def _keep(case: Path, folder: Path, words: str, outcome: Outcome) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(case, folder, symlinks=True, copy_function=_copy)
    text = f"{words}\n{outcome.kind}: {outcome.words}\n\n{outcome.details}\n"
    (folder / "outcome.txt").write_text(text, encoding="utf-8", errors="surrogateescape")
