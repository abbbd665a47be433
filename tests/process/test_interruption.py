"""Ctrl-C and SIGTERM end a command with a sentence, and what it has started ends with it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from uvcloth.process.interruption import uninterrupted

LIMIT = 60
"""Seconds that a test waits at most; a machine may be busy."""

COMMAND = """
import signal, sys, time
from pathlib import Path
from uvcloth.files.atomic import atomic_write
from uvcloth.process.command import run_command

def write():
    with atomic_write(Path(sys.argv[1]) / "a.txt") as partial:
        partial.write_text("half")
        while True:
            try:
                print("ready", flush=True)
                time.sleep(60)
            except KeyboardInterrupt:
                if sys.argv[2] == "ends":
                    raise
                if sys.argv[2] == "returns":
                    return

# What is started in the background is deaf to Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.exit(run_command("uvcloth", write))
"""

POOL = """
import os, time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from uvcloth.process.children import end_with_parent

if __name__ == "__main__":
    pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=end_with_parent)
    print(pool.submit(os.getpid).result(), flush=True)
    time.sleep(60)
"""


def start(*words: str) -> subprocess.Popen:
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, *words], stdout=pipe, stderr=pipe, text=True)


@pytest.mark.parametrize("stubborn", [False, True])
@pytest.mark.parametrize(
    ("sent", "code", "said"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_a_signal_ends_a_command_with_one_sentence(
    sent: signal.Signals, code: int, said: str, stubborn: bool, tmp_path: Path
) -> None:
    """One that catches it, as a long computation does not hear of it, is ended too."""
    with start("-c", COMMAND, str(tmp_path), "stays" if stubborn else "ends") as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            process.send_signal(sent)
            _, errors = process.communicate(timeout=LIMIT)
        finally:
            process.kill()
    assert (process.returncode, errors) == (code, f"uvcloth: {said}; finished work is in place\n")
    assert [path.name for path in tmp_path.iterdir()] == ([".a.txt.partial"] if stubborn else [])


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_a_command_that_ctrl_c_ends_well_is_terminated_by_sigterm(
    sent: signal.Signals, code: int, tmp_path: Path
) -> None:
    """As the live view is, which serves its page until Ctrl-C."""
    with start("-c", COMMAND, str(tmp_path), "returns") as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            process.send_signal(sent)
            process.communicate(timeout=LIMIT)
        finally:
            process.kill()
    assert process.returncode == code


def test_children_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    (tmp_path / "pool.py").write_text(POOL)
    with start(str(tmp_path / "pool.py")) as process:
        try:
            assert process.stdout is not None
            child = int(process.stdout.readline())
            assert _lives(child)
        finally:
            process.kill()
    end = time.monotonic() + LIMIT
    while _lives(child) and time.monotonic() < end:
        time.sleep(0.05)
    assert not _lives(child)


def _lives(number: int) -> bool:
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{number}/stat")
    return not state.exists() or state.read_text().rpartition(")")[2].split()[0] != "Z"


def test_the_first_signal_waits_for_the_end_of_a_block_and_the_second_does_not() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), uninterrupted() as interrupted:  # noqa: PT012
        assert not interrupted()
        signal.raise_signal(signal.SIGINT)
        assert interrupted()
        done.append(1)
    assert done == [1]
    with pytest.raises(KeyboardInterrupt), uninterrupted():  # noqa: PT012
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        done.append(2)
    assert done == [1]
