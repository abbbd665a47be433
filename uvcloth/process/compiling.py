"""Child process that compiles functions for `uvcloth.process.compiled`, run as a module.

Each task on stdin is a pickled module, function and types of arguments; a byte on stdout answers it. The
child ends when stdin is closed, in the middle of a task too, and when no task has come for a while.
"""

import os
import pickle
import signal
import sys
import threading
from importlib import import_module
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from filelock import FileLock

from uvcloth.process.compiled import DONE, FAILED, ChildCache

LOCK = "compiling.lock"
"""File in the folder of compiled functions that a process locks while it compiles into it."""

IDLE_SECONDS = 60.0
"""Seconds without a task after which the child ends."""


def main() -> None:
    """Compile functions, but for those that another process has compiled in the meantime."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    tasks: SimpleQueue[Any] = SimpleQueue()
    threading.Thread(target=_read_tasks, args=(tasks,), daemon=True).start()
    ChildCache.compiles_here = True
    while True:
        try:
            module, name, types = tasks.get(timeout=IDLE_SECONDS)
        except Empty:
            return
        try:
            _compile(getattr(import_module(module), name), types)
            answer = DONE
        except Exception:
            answer = FAILED
        sys.stdout.buffer.write(answer)
        sys.stdout.buffer.flush()


def _compile(dispatcher: Any, types: Any) -> None:
    folder = Path(dispatcher._cache.cache_path)
    folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / LOCK):
        dispatcher.compile(types)


def _read_tasks(tasks: "SimpleQueue[Any]") -> None:
    try:
        while True:
            tasks.put(pickle.load(sys.stdin.buffer))
    finally:
        os._exit(1)


if __name__ == "__main__":
    main()
