"""Trials: a command is killed at a random moment, run again, and compared with a run that nobody disturbed.

The process that calls this has imported what commands need and started no thread: each run is a fork of it.
"""

import hashlib
import json
import os
import random
import shutil
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from safetensors import safe_open

HARD_LIMIT = 300.0
"""Seconds after which a run counts as one that hangs."""

PROGRAMS: dict[str, Callable[[], int]] = {}
"""Entry points by program."""

UNEQUAL = ("seconds", "minutes", "date", "_ms", "ms_")
"""Parts of keys of a metrics.json that depend on the clock."""


@dataclass(frozen=True)
class Command:
    """A command: words of its line, in which OUT stands for its folder, and how its results are compared.

    results: "bytes" of every file, "weights" of a training, "scores" of an evaluation. again: what is added
    when it is run again in a folder that holds a training state. indifferent: what is added to one of two
    undisturbed runs, and has to make no difference.
    """

    name: str
    program: str
    words: tuple[str, ...]
    results: str = "bytes"
    again: tuple[str, ...] = ()
    indifferent: tuple[str, ...] = ()


@dataclass
class Tally:
    """Counts of the trials of a command."""

    seconds: float = 0.0
    kills: int = 0
    leftovers: int = 0
    faults: list[str] = field(default_factory=list)


def try_command(command: Command, times: int, folder: Path, seed: int) -> Tally:
    """Kill a command `times` times in fresh folders, and run it again in each."""
    tally, truths = Tally(), []
    for number in range(2):
        out = folder / f"{command.name}-{number}"
        begun = time.monotonic()
        code = _ended(_start(command, out, command.indifferent * number))
        tally.seconds = time.monotonic() - begun
        if code:
            tally.faults.append(f"undisturbed: code {code}, {_said(out)}")
            return tally
        truths.append(digest(out, command.results))
    if truths[0] != truths[1]:
        names = sorted(n for n in truths[0] | truths[1] if truths[0].get(n) != truths[1].get(n))
        tally.faults.append(f"two undisturbed runs differ: {names[:4]}")
        return tally
    draw = random.Random(f"{seed} {command.name}")
    for number in range(times):
        out = folder / f"{command.name}-killed-{number}"
        moment = draw.uniform(0.0, tally.seconds)
        child = _start(command, out)
        if _killed(child, moment):
            tally.kills += 1
            tally.leftovers += bool(hidden(out))
        fault = _again(command, out, truths[0])
        if fault:
            tally.faults.append(f"killed after {moment:.2f} s: {fault}")
        else:
            shutil.rmtree(out, ignore_errors=True)
            _log(out).unlink(missing_ok=True)
    return tally


def _again(command: Command, out: Path, truth: dict[str, str]) -> str:
    """Run a command again; returns what is wrong with that, "" for nothing."""
    began = any(out.rglob("state.safetensors"))
    code = _ended(_start(command, out, command.again if began else ()))
    if code:
        return f"the second run ended with {code}, {_said(out)}"
    if left := hidden(out):
        return f"left hidden: {left[:4]}"
    found = digest(out, command.results)
    if found != truth:
        names = sorted(n for n in found | truth if found.get(n) != truth.get(n))
        return f"other results: {names[:4]}"
    return ""


def hidden(out: Path) -> list[str]:
    """Hidden files and folders in a folder."""
    return [str(path.relative_to(out)) for path in out.rglob(".*")]


def digest(out: Path, results: str) -> dict[str, str]:
    """What is compared of a folder, by name."""
    files = sorted(path for path in out.rglob("*") if path.is_file())
    if results == "weights":
        return {
            f"{path.relative_to(out)} {name}": value
            for path in files
            if path.suffix == ".safetensors"
            for name, value in _tensors(path).items()
        }
    if results == "scores":
        scores = _plain(json.loads((out / "metrics.json").read_text()))
        return {"metrics.json": json.dumps(scores), "report": str((out / "report.html").exists())}
    return {str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def _tensors(path: Path) -> dict[str, str]:
    with safe_open(path, framework="pt") as archive:
        return {
            name: hashlib.sha256(archive.get_tensor(name).contiguous().numpy().tobytes()).hexdigest()
            for name in archive.keys()  # noqa: SIM118
        }


def _plain(values: object) -> object:
    """JSON values without what depends on the clock."""
    if isinstance(values, dict):
        return {k: _plain(v) for k, v in values.items() if not any(part in k for part in UNEQUAL)}
    return [_plain(value) for value in values] if isinstance(values, list) else values


def _log(out: Path) -> Path:
    return out.with_suffix(".log")


def _said(out: Path) -> str:
    return _log(out).read_text(errors="replace").strip()[-600:]


def _start(command: Command, out: Path, more: Sequence[str] = ()) -> int:
    """Fork a process that runs a command in a session of its own; returns its number."""
    child = os.fork()
    if child:
        return child
    code = 70
    try:
        os.setsid()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        log = os.open(_log(out), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(log, 1)
        os.dup2(log, 2)
        words = [word.replace("OUT", str(out)) for word in (*command.words, *more)]
        sys.argv = [command.program, *words]
        code = PROGRAMS[command.program]()
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 70
    except BaseException as error:
        print(repr(error), file=sys.stderr)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _ended(child: int, seconds: float = HARD_LIMIT) -> int:
    """Wait for a process and its session; returns its exit code, and kills what hangs."""
    end = time.monotonic() + seconds
    while True:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status) or _stray(child)
        if time.monotonic() > end:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return 124
        time.sleep(0.002)


def _killed(child: int, moment: float) -> bool:
    """Kill a process after some seconds, unless it has ended by then, and wait for its children."""
    end = time.monotonic() + moment
    while time.monotonic() < end:
        if os.waitpid(child, os.WNOHANG)[0]:
            return False
        time.sleep(min(0.002, max(end - time.monotonic(), 0.0)))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    if _stray(child):
        raise RuntimeError(f"processes of session {child} go on after it was killed")
    return True


def _stray(session: int, seconds: float = 30.0) -> int:
    """Wait until no process of a session is left; returns 75 if some stay, and kills those."""
    end = time.monotonic() + seconds
    while left := [process for process in map(_session, _numbers()) if process and process[1] == session]:
        if time.monotonic() > end:
            for number, _ in left:
                os.kill(number, signal.SIGKILL)
            return 75
        time.sleep(0.02)
    return 0


def _numbers() -> list[int]:
    return [int(entry) for entry in os.listdir("/proc") if entry.isdigit()]


def _session(number: int) -> tuple[int, int] | None:
    """A process and its session, None if it has ended: all its threads, which hold its locks."""
    try:
        fields = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    state, threads = fields[0], int(fields[17])
    return None if state == "Z" and threads <= 1 else (number, int(fields[3]))
