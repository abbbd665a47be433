"""Processes that simulate, on this machine or those of a dask scheduler, and those that are lost."""

import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from uvcloth.errors import InputError
from uvcloth.process.children import kill_children
from uvcloth.simulation.plan import Job

UNWATCHED = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.admin.system-monitor.gil.enabled": False,
}
"""Settings of dask that keep it from watching its workers many times a second, on the cores that simulate."""

JOBS_PER_CORE = 2
"""Simulations that are submitted per core: one runs, one waits."""

ATTEMPTS = 3
"""Most times that a job is submitted: dask forgets jobs when processes were paused (a laptop that slept)."""

LOOK_SECONDS = 0.2
"""Seconds between two looks for finished jobs."""


@dataclass(frozen=True)
class Workers:
    """Processes that simulate: `jobs` on this machine, None for one per core, or those of a dask scheduler.

    scheduler: its address.
    """

    jobs: int | None = None
    scheduler: str | None = None


ONE_PER_CORE = Workers()


@contextmanager
def connected(workers: Workers, at_most: int | None) -> Iterator[Any]:
    """Client of the workers: those of a scheduler, or of this machine, no more than `at_most`.

    Those of this machine end with the block. Raises InputError without dask, and for a scheduler that does
    not answer.
    """
    try:
        import dask
        from dask.distributed import LocalCluster
    except ModuleNotFoundError as error:
        raise InputError("simulating needs dask: install uvcloth[simulate]") from error
    with dask.config.set(UNWATCHED):
        if workers.scheduler is not None:
            with _client(workers.scheduler) as client:
                yield client
            return
        count = workers.jobs or os.cpu_count() or 1
        cluster = LocalCluster(
            n_workers=count if at_most is None else min(count, at_most),
            threads_per_worker=1,
            dashboard_address="localhost:0",
            silence_logs=50,
        )
        try:
            with _client(cluster) as client:
                try:
                    yield client
                except BaseException:
                    # Running simulations are not waited for.
                    for nanny in cluster.workers.values():
                        nanny.close_gracefully()
                    kill_children()
                    raise
        finally:
            with suppress(TimeoutError):
                cluster.close(timeout=30)


def results(
    client: Any, todo: Iterable[Job], work: Callable[[Job], Any], look: Callable[[], None]
) -> Iterator[tuple[Job, Any]]:
    """Do `work` on jobs in the client's workers, and yield each job and its result as it is done.

    todo: is asked for the next job when there is room for it. look: is called now and then, and may raise. A
    job whose worker dies, or that dask forgets, is repeated. Raises InputError if the scheduler is lost, or
    a job is lost for the ATTEMPTS-th time.
    """
    from dask.distributed import as_completed
    from distributed.comm.core import CommClosedError

    queue, running = iter(todo), as_completed()
    waiting: dict[Any, tuple[Job, int]] = {}

    def submit(job: Job, attempt: int) -> None:
        future = client.submit(work, job, pure=False)
        waiting[future] = job, attempt
        running.add(future)

    def fill() -> None:
        """Submit a few jobs: all at once would fill the scheduler's memory with motion and cloth."""
        while len(waiting) < JOBS_PER_CORE * max(sum(client.nthreads().values()), 1):
            job = next(queue, None)
            if job is None:
                return
            submit(job, 1)

    try:
        fill()
        while waiting:
            while not running.has_ready():
                look()
                time.sleep(LOOK_SECONDS)
            future = next(running)
            job, attempt = waiting.pop(future)
            if forgotten(future, job):
                if client.status != "running":
                    raise _lost("the dask scheduler")
                if attempt == ATTEMPTS:
                    raise _lost(f"{job.motion.name}: the process that simulated it")
                submit(job, attempt + 1)
                continue
            look()
            yield job, future.result()
            future.release()
            fill()
    except CommClosedError as error:
        raise _lost("the dask scheduler") from error


def forgotten(future: Any, job: Job) -> bool:
    """True if dask has forgotten the job. Raises InputError if worker after worker died on it."""
    from dask.distributed import KilledWorker

    try:
        future.result()
    except CancelledError:
        return True
    except KilledWorker as error:
        raise _lost(f"{job.motion.name}: every process that simulated it") from error
    return False


def _client(cluster: Any) -> Any:
    """Connect a client to a local cluster, or to the scheduler at an address."""
    from dask.distributed import Client

    try:
        return Client(cluster)
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {cluster}: no dask scheduler answers there ({error})") from error


def _lost(who: str) -> InputError:
    return InputError(
        f"{who} has ended or does not answer; finished sequences are kept, run the command again to continue"
    )
