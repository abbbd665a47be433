"""Mutated files: every reader ends in the documented error or in a value that passes its checks."""

import os
import signal
import time
from pathlib import Path
from random import Random

import pytest

from tests.fuzz.byte_mutators import pipe_instead
from tests.fuzz.case import Corpus
from tests.fuzz.registry import TARGETS
from tests.fuzz.runner import try_reader
from tests.fuzz.target import Target, require
from tests.fuzz.worker import FINE, Worker
from uvcloth.errors import InputError

CASES = 60
"""Of each reader; `make fuzz` tries 10,000."""


@pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)
def test_mutated_files_end_as_documented(target: Target) -> None:
    tally = try_reader(target, range(int(CASES * target.share)))
    assert [(number, words, outcome.kind, outcome.words) for number, words, outcome in tally.failures] == []
    assert tally.kinds["refused"] > 0.2 * tally.kinds.total(), "mutations that a reader hardly ever sees"


def test_a_pipe_in_the_place_of_any_file_is_refused_at_once(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("tests.fuzz.worker.WALL_SECONDS", 10.0)
    outcomes = {}
    for name, target in TARGETS.items():
        corpus = Corpus(target, tmp_path / name)
        files = [path.relative_to(corpus.good) for path in corpus.good.rglob("*") if path.is_file()]
        with Worker(target) as worker:
            for file in files:
                path = corpus.copy(tmp_path / name / "case")
                pipe_instead(tmp_path / name / "case" / file, Random(0))
                outcomes[f"{name}, {file}"] = worker.judge(path).kind
    assert {place: kind for place, kind in outcomes.items() if kind not in FINE} == {}
    assert sum(kind == "refused" for kind in outcomes.values()) >= len(TARGETS)


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
        (endless, "hang"),
        (blocked, "hang"),
        (greedy, "memory"),
        (killed, "crash"),
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
