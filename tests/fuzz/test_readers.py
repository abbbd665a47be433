"""Mutated files: every reader ends in the documented error or in a value that passes its checks."""

import os
import signal
import time
from pathlib import Path
from random import Random
from typing import Any

import pytest

from tests.fuzz.byte_mutators import pipe_instead
from tests.fuzz.case import Corpus
from tests.fuzz.registry import TARGETS
from tests.fuzz.runner import try_reader
from tests.fuzz.target import Target, require
from tests.fuzz.worker import FINE, Worker
from tests.thorough import always
from uvcloth.errors import InputError

CASES, THOROUGH_CASES, LEAST = 8, 60, 2
"""Of each reader, few of one that takes long; `make fuzz` tries 10,000."""


@pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)
def test_mutated_files_end_as_documented(target: Target, request: pytest.FixtureRequest) -> None:
    thorough = request.config.getoption("thorough")
    cases = int((THOROUGH_CASES if thorough else CASES) * target.share)
    tally = try_reader(target, range(max(cases, LEAST)))
    assert [(number, words, outcome.kind, outcome.words) for number, words, outcome in tally.failures] == []
    share = 0.2 if thorough else 0.0
    assert tally.kinds["refused"] > share * tally.kinds.total(), "mutations that a reader hardly ever sees"


def all_targets(folder: Path) -> Target:
    """All readers as one, which a single worker tries: each reads the files of its name in a folder."""

    def read(path: Path) -> tuple[Target, Any]:
        target = TARGETS[path.relative_to(folder).parts[0]]
        return target, target.read(path)

    return Target("all", good_file, read, lambda pair: pair[0].check(pair[1]))


@pytest.mark.parametrize("every", always([8], [8, 1]))
def test_a_pipe_in_the_place_of_any_file_is_refused_at_once(every: int, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("tests.fuzz.worker.WALL_SECONDS", 10.0)
    outcomes = {}
    with Worker(all_targets(tmp_path)) as worker:
        for name, target in list(TARGETS.items())[::every]:
            corpus = Corpus(target, tmp_path / name)
            files = [path.relative_to(corpus.good) for path in corpus.good.rglob("*") if path.is_file()]
            for file in files:
                path = corpus.copy(tmp_path / name / "case")
                pipe_instead(tmp_path / name / "case" / file, Random(0))
                outcomes[f"{name}, {file}"] = worker.judge(path).kind
    assert {place: kind for place, kind in outcomes.items() if kind not in FINE} == {}
    assert sum(kind == "refused" for kind in outcomes.values()) >= len(TARGETS) // every


def good_file(folder: Path) -> Path:
    (folder / "a.txt").write_text("1 2 3\n")
    return folder / "a.txt"


def endless(path: Path) -> None:
    while True:
        pass


def blocked(path: Path) -> None:
    time.sleep(60)


def greedy(path: Path) -> None:
    try:
        bytearray(1 << 31)
    except MemoryError as error:
        raise InputError(f"{path}: too large") from error


def killed(path: Path) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def refused(path: Path) -> None:
    raise InputError(f"{path}: not a table")


def refused_namelessly(path: Path) -> None:
    raise InputError("not a table")


def refused_in_two_lines(path: Path) -> None:
    raise InputError(f"{path}: not\na table")


def raising(path: Path) -> None:
    raise KeyError("a")


@pytest.mark.parametrize(
    ("read", "kind"),
    [
        (Path.read_bytes, "read"),
        (refused, "refused"),
        (refused_namelessly, "sentence"),
        (refused_in_two_lines, "sentence"),
        (raising, "exception"),
        (lambda path: "other", "contradiction"),
        *(
            pytest.param(*each, marks=pytest.mark.thorough)
            for each in ((endless, "hang"), (blocked, "hang"), (greedy, "memory"), (killed, "crash"))
        ),
    ],
)
def test_a_reader_that_fails_is_told_from_one_that_does_not(read, kind, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("tests.fuzz.worker.WALL_SECONDS", 1.0 if read is blocked else 30.0)
    monkeypatch.setattr("tests.fuzz.worker.SECONDS", 0.2)
    target = Target("planted", good_file, read, lambda value: require(value == b"1 2 3\n", "another text"))
    path = good_file(tmp_path)
    with Worker(target) as worker:
        assert worker.judge(path).kind == kind
        assert worker.judge(path).kind == kind, "the worker does not go on"


def test_a_case_is_known_by_its_number(tmp_path: Path) -> None:
    """The same seed and number make the same file; another number another one."""

    def mutated(number: int, folder: str) -> tuple[str, list[bytes]]:
        corpus = Corpus(TARGETS["clip"], tmp_path / folder)
        path, words = corpus.case(0, number, tmp_path / folder / "case")
        return words, [each.read_bytes() for each in sorted(path.parent.iterdir()) if each.is_file()]

    assert mutated(3, "a") == mutated(3, "b")
    assert mutated(3, "c") != mutated(4, "d")
