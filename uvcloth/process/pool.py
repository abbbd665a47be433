"""The same work in several processes of this machine, which end together with this one."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from typing import TypeVar

from uvcloth.errors import InputError
from uvcloth.process.children import end_with_parent, kill_children

Job = TypeVar("Job")
Result = TypeVar("Result")


@contextmanager
def pool(
    work: Callable[[Job], Result], count: int, doing: str, fresh: bool = False
) -> Iterator[Callable[[Iterable[Job]], Iterator[Result]]]:
    """Function that does `work`, a function of a module, on jobs, and yields each result when it is done.

    doing: "made outfits", for the message. fresh: give each job a new process. Raises InputError if a process
    is lost.
    """
    # Threads of torch and warp do not survive a fork.
    with ProcessPoolExecutor(
        count,
        mp_context=get_context("spawn"),
        initializer=end_with_parent,
        max_tasks_per_child=1 if fresh else None,
    ) as executor:
        try:
            yield lambda jobs: (
                done.result() for done in as_completed([executor.submit(work, job) for job in jobs])
            )
        except BaseException as error:
            kill_children()
            executor.shutdown(wait=True, cancel_futures=True)
            if isinstance(error, BrokenProcessPool):
                raise InputError(
                    f"a process that {doing} has ended; finished work is kept, "
                    "run the command again to continue"
                ) from error
            raise
