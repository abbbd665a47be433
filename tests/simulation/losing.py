"""Work that is lost on its way, for workers that import this and nothing heavy."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace


@dataclass(frozen=True)
class Errand:
    """As much of a job as those who hand it out look at; flag: a file that its attempts have in common."""

    flag: Path

    @property
    def motion(self) -> SimpleNamespace:
        """Its motion, by name."""
        return SimpleNamespace(name="walk")


def die_at_first(errand: Errand) -> str:
    """Kill the worker, once."""
    if not errand.flag.exists():
        errand.flag.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def wait_for_flag(errand: Errand) -> str:
    """Wait for the file."""
    while not errand.flag.exists():
        time.sleep(0.01)
    return "done"
