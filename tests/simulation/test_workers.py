"""Workers and schedulers that die, and jobs that dask forgets: nothing waits for a moment, all is limited."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from dask.distributed import Client, Future, LocalCluster

from tests.simulation.losing import Errand, die_at_first, wait_for_flag
from uvcloth.errors import InputError
from uvcloth.simulation.workers import Workers, connected, results

LIMIT = 240
"""Seconds for a test; a machine may be busy."""

IN_ONE_PROCESS = {"processes": False, "n_workers": 1, "threads_per_worker": 1, "dashboard_address": None}

SCHEDULER = f"""
import sys
from dask.distributed import LocalCluster
print(LocalCluster(**{IN_ONE_PROCESS}, protocol="tcp://").scheduler_address, flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def _limit() -> Iterator[None]:
    def end(number: int, frame: object) -> None:
        raise TimeoutError(f"more than {LIMIT} s")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(LIMIT)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def made(client: Any, errand: Errand, work: Any, look: Any = lambda: None) -> list[str]:
    return [result for _, result in results(client, [errand], work, look)]  # type: ignore[list-item]


def test_a_worker_that_dies_is_replaced_and_its_job_made_again(tmp_path: Path) -> None:
    errand = Errand(tmp_path / "died")
    with connected(Workers(jobs=1), 1) as client:
        assert made(client, errand, die_at_first) == ["done"]
    assert errand.flag.exists()


def test_a_scheduler_that_dies_is_one_sentence(tmp_path: Path) -> None:
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", SCHEDULER], stdin=pipe, stdout=pipe, text=True) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().strip()
            with (
                pytest.raises(InputError, match=r"the dask scheduler has ended .* run the command again"),
                connected(Workers(scheduler=address), None) as client,
            ):
                # Its worker is a thread of its own process.
                made(client, Errand(tmp_path / "died"), die_at_first)
        finally:
            process.kill()


def test_a_job_that_dask_forgets_is_asked_for_again_and_not_for_ever(tmp_path: Path) -> None:
    forgotten: list[int] = []

    def forget(times: int) -> None:
        keys = [key for key, state in client.futures.items() if state.status == "pending"]
        if keys and len(forgotten) < times:
            forgotten.append(len(keys))
            client.cancel([Future(key, client) for key in keys], force=True)
        else:
            (tmp_path / "flag").touch()

    with LocalCluster(**IN_ONE_PROCESS) as cluster, Client(cluster) as client:
        assert made(client, Errand(tmp_path / "flag"), wait_for_flag, lambda: forget(2)) == ["done"]
        assert forgotten == [1, 1]
        (tmp_path / "flag").unlink()
        forgotten.clear()
        with pytest.raises(InputError, match="walk: the process that simulated it has ended"):
            made(client, Errand(tmp_path / "flag"), wait_for_flag, lambda: forget(3))
        (tmp_path / "flag").touch()


def test_a_folder_that_vanishes_ends_the_wait_at_once(tmp_path: Path) -> None:
    def gone() -> None:
        raise InputError("out: was removed")

    with LocalCluster(**IN_ONE_PROCESS) as cluster, Client(cluster) as client:
        with pytest.raises(InputError, match="out: was removed"):
            made(client, Errand(tmp_path / "flag"), wait_for_flag, gone)
        (tmp_path / "flag").touch()
