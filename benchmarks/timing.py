"""How benchmarks take times."""

import time
from collections.abc import Callable


def fastest(run: Callable[[], object], rounds: int, clock: Callable[[], float] = time.perf_counter) -> float:
    """Seconds of the fastest of several runs, after one that does not count.

    clock: time.thread_time takes the processor's time for this thread, whatever else the machine does.
    """
    run()
    times = []
    for _ in range(rounds):
        begun = clock()
        run()
        times.append(clock() - begun)
    return min(times)
