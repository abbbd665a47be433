"""Judging in several processes beside each other: they fill the records, which the comparison then reads."""

import os
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import cache, lru_cache
from io import StringIO

from uvcloth.process.threads import limited_threads

from .candidates import Candidate, load_candidates
from .case import Case
from .compare import entrants_of
from .familiar import Entrant
from .predicted import Prediction, load_predictions
from .progress import progress
from .records import Records
from .selection import Cases, Opener, Selection, find_cases
from .workers import Work

WORTH_A_PROCESS = 8
"""Fewest methods on cases for each process, whose start takes as long as judging one."""


@dataclass(frozen=True)
class Request:
    """A comparison in the words of the command line, from which every process loads it.

    models, predicted: of the options. threads: of each process.
    """

    selection: Selection
    models: tuple[str, ...]
    predicted: tuple[str, ...]
    threads: int


@dataclass(frozen=True)
class Comparison:
    """The cases and the methods and predictions that are judged on them."""

    cases: Cases
    candidates: tuple[Candidate, ...]
    predictions: tuple[Prediction, ...]

    def entrants(self) -> list[tuple[Opener, list[Entrant]]]:
        """Those that can be judged on each case. Raises InputError as `entrants_of` does."""
        return entrants_of(self.candidates, self.predictions, self.cases)


def load_comparison(request: Request) -> Comparison:
    """Load what is compared. Raises InputError as `find_cases`, `load_candidates`, `load_predictions` do."""
    cases = find_cases(request.selection)
    candidates = load_candidates(request.models, cases.body)
    names = [candidate.name for candidate in candidates]
    return Comparison(cases, candidates, load_predictions(request.predicted, names))


def processes(comparison: Comparison, jobs: int | None) -> int:
    """The number of processes that judge, at most `jobs` (None: one per core); each needs enough to do."""
    judged = sum(1 + len(each) for _, each in comparison.entrants())
    return max(1, min(jobs or os.cpu_count() or 1, judged // WORTH_A_PROCESS))


def judge_beside(request: Request, comparison: Comparison, records: Records, work: Work) -> None:
    """Judge what the records lack by some workers."""
    todo = [
        _Judged(request, records, number, None if entrant is None else entrant.name)
        for number, (opener, entrants) in enumerate(comparison.entrants())
        for case in [opener.load()]
        for entrant in (None, *entrants)
        if not records.path(case, entrant).is_file()
    ]
    if todo:
        with progress("Judging", len(todo)) as tick:
            for note in work(todo):
                tick(note=note)


@dataclass(frozen=True)
class _Judged:
    """A method, None for the simulation, on a case, by its number."""

    request: Request
    records: Records
    number: int
    name: str | None

    def run(self) -> str:
        """Judge and keep; returns what was judged, in words."""
        with limited_threads(self.request.threads):
            entrant = None
            if self.name is not None:
                entrants = _loaded(self.request)[self.number][1]
                entrant = next(each for each in entrants if each.name == self.name)
            case = _case(self.request, self.number)
            self.records.scores(case, entrant)
        return f"{case.action}, {case.parts[-1].name}" + (f": {self.name}" if self.name else "")


@cache
def _loaded(request: Request) -> list[tuple[Opener, list[Entrant]]]:
    # What loading says was said by the process that asks.
    with redirect_stdout(StringIO()):
        return load_comparison(request).entrants()


@lru_cache(maxsize=1)
def _case(request: Request, number: int) -> Case:
    return _loaded(request)[number][0].load()
