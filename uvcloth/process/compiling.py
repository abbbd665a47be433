"""Child process that compiles one function for `uvcloth.process.compiled`, run as a module.

It reads a pickled module, function and types of arguments from stdin, and ends when stdin is closed.
"""

import os
import pickle
import sys
import threading
from importlib import import_module
from pathlib import Path

from filelock import FileLock

from uvcloth.process.compiled import ChildCache

LOCK = "compiling.lock"
"""File in the folder of compiled functions that a process locks while it compiles into it."""


def main() -> None:
    """Compile the function, unless another process has done so in the meantime."""
    module, name, types = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_stdin, daemon=True).start()
    ChildCache.compiles_here = True
    dispatcher = getattr(import_module(module), name)
    folder = Path(dispatcher._cache.cache_path)
    folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / LOCK):
        dispatcher.compile(types)


def _end_with_stdin() -> None:
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)


if __name__ == "__main__":
    main()
