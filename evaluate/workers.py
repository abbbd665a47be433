"""Processes that judge and draw for a report."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from uvcloth.process.pool import pool


class PoolTask(Protocol):
    """A piece of work that another process can do."""

    def run(self) -> Any:
        """Do it."""
        ...


Work = Callable[[Iterable[PoolTask]], Iterator[Any]]
"""Runs jobs, and yields each result when it is done."""


@contextmanager
def workers(count: int) -> Iterator[Work]:
    """So many processes that run jobs; for one, this process. Raises InputError if one of them is lost."""
    if count > 1:
        with pool(_run, count, "judged methods") as work:
            yield work
    else:
        yield lambda jobs: map(_run, jobs)


def _run(job: PoolTask) -> Any:
    return job.run()
