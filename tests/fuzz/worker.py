"""A forked process that reads mutated files within limits of time and memory.

What a reader imports is imported once, in the process that forks. CPU time is limited, not the time on the
clock, which on a busy machine is no property of the reader; a file that blocks is ended after WALL_SECONDS.
"""

import gc
import multiprocessing
import os
import resource
import signal
import time
import traceback
import warnings
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType
from typing import Any

import torch

from tests.fuzz.target import Target
from uvcloth.errors import InputError

SECONDS = 2.0
"""Seconds of CPU within which a reader has to be done."""

WALL_SECONDS = 30.0
"""Seconds on the clock after which a reader is taken to hang."""

MEMORY = 1 << 30
"""Bytes that a reader may take beside what the imports have."""

FINE = ("read", "refused")
"""Outcomes as documented; the others are bugs."""


@dataclass(frozen=True)
class Outcome:
    """The end of one case.

    kind: "read" (a value that passes the target's check), "refused" (InputError that names the file),
    "contradiction" (a value that does not pass), "sentence" (InputError that is not one line, or names no
    file), "exception" (another one, or a warning), "hang", "memory" or "crash". words: the error's sentence.
    details: a traceback. seconds: of CPU. megabytes: by which the process grew.
    """

    kind: str
    words: str = ""
    details: str = ""
    seconds: float = 0.0
    megabytes: float = 0.0


class TooSlowError(BaseException):
    """The limit of CPU time; no `except Exception` of a reader catches it."""


class Worker:
    """Reads files of one target in a forked process, forked anew after a file that it did not survive."""

    def __init__(self, target: Target) -> None:
        self.target = target
        self._process: Any = None
        self._connection: Connection | None = None

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, *error: object) -> None:
        self._end()

    def judge(self, path: Path) -> Outcome:
        """Read a file and judge the outcome. One that exceeds a limit is read again in a new process, whose
        memory nothing else has fragmented; a reader that is too slow is too slow twice."""
        outcome = self._judge(path)
        if outcome.kind in ("memory", "hang"):
            self._end()
            outcome = self._judge(path)
        return outcome

    def _judge(self, path: Path) -> Outcome:
        if self._connection is None:
            self._connection, theirs = multiprocessing.Pipe()
            with warnings.catch_warnings():
                # Newer Pythons warn of forks of processes with threads; the child uses none of theirs.
                warnings.simplefilter("ignore")
                self._process = multiprocessing.get_context("fork").Process(
                    target=_serve, args=(theirs, self.target), daemon=True
                )
                self._process.start()
            theirs.close()
        try:
            self._connection.send(path)
            if self._connection.poll(WALL_SECONDS):
                return self._connection.recv()
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode
            self._end()
            return Outcome("crash", f"the process ended with exit code {code}")
        self._end()
        return Outcome("hang", f"no answer within {WALL_SECONDS:g} s on the clock", seconds=WALL_SECONDS)

    def _end(self) -> None:
        if self._connection is not None:
            self._connection.close()
            self._process.kill()
            self._process.join()
            self._connection = self._process = None


def judge(target: Target, path: Path) -> Outcome:
    """Read a file without limits of memory, in this process; exceptions become outcomes."""
    start = time.process_time()
    try:
        value = target.read(path)
    except InputError as error:
        kind, words = _sentence(error, path), str(error)
        return Outcome(kind, words, _trace(error), time.process_time() - start)
    except TooSlowError as error:
        return Outcome("hang", f"more than {SECONDS:g} s of CPU", _trace(error), time.process_time() - start)
    except Exception as error:
        kind = "memory" if _out_of_memory(error) else "exception"
        return Outcome(kind, f"{type(error).__name__}: {error}", _trace(error), time.process_time() - start)
    seconds = time.process_time() - start
    try:
        target.check(value)
    except Exception as error:
        return Outcome("contradiction", str(error), _trace(error), seconds)
    return Outcome("read", "", "", seconds)


def _serve(connection: Connection, target: Target) -> None:
    """Judge the paths that come, until the other end is closed."""
    # A collection would touch all objects of the process that forked, and so copy its memory.
    gc.freeze()
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGPROF, _too_slow)
    torch.set_num_threads(1)
    warnings.simplefilter("error")
    used = _status("VmSize")
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))
    while True:
        try:
            path = connection.recv()
        except EOFError:
            os._exit(0)
        before = _status("VmRSS")
        Path("/proc/self/clear_refs").write_text("5")
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        try:
            outcome = judge(target, path)
        except TooSlowError as error:
            outcome = Outcome(
                "hang", f"more than {SECONDS:g} s of CPU with the check", _trace(error), SECONDS
            )
        signal.setitimer(signal.ITIMER_PROF, 0)
        grown = max(_status("VmHWM") - before, 0) / 1e6
        connection.send(Outcome(outcome.kind, outcome.words, outcome.details, outcome.seconds, grown))


def _too_slow(number: int, frame: FrameType | None) -> None:
    raise TooSlowError


def _status(name: str) -> int:
    """A size of this process in bytes, by its name in /proc/self/status."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) * 1024
    raise RuntimeError(f"/proc/self/status has no {name}")


def _sentence(error: InputError, path: Path) -> str:
    """The kind of outcome that an InputError is: a sentence in one line of the file, or not."""
    text = str(error)
    if _out_of_memory(error):
        return "memory"
    one_line = len(text.splitlines()) == 1 and len(text) < 2000
    named = any(part in text for part in (str(path), path.name, path.parent.name))
    return "refused" if one_line and named else "sentence"


def _out_of_memory(error: BaseException | None) -> bool:
    """Test whether an error comes of memory that was asked for and refused."""
    while error is not None:
        if isinstance(error, MemoryError) or "allocate memory" in str(error):
            return True
        error = error.__cause__ or error.__context__
    return False


def _trace(error: BaseException) -> str:
    return "".join(traceback.format_exception(error, limit=-12))[-6000:]
