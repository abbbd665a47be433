"""How benchmarks take times."""

import time
from collections.abc import Callable


def fastest(run: Callable[[], object], rounds: int) -> float:
    """Seconds of the fastest of several runs, after one that does not count."""
    run()
    times = []
    for _ in range(rounds):
        begun = time.perf_counter()
        run()
        times.append(time.perf_counter() - begun)
    return min(times)
