"""Child processes end together with this process, also when it is killed."""

import multiprocessing
import os
import signal
import threading


def end_with_parent() -> None:
    """Let the process that calls this, a child, end at once when its parent does; Ctrl-C is the parent's.

    A child of a parent that is killed would otherwise wait for its next task for ever.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_wait_for_end, args=(parent,), daemon=True).start()


def kill_children() -> None:
    """Kill the processes that multiprocessing started for this one, and wait for their ends."""
    children = multiprocessing.active_children()
    for child in children:
        child.kill()
    for child in children:
        child.join()


def _wait_for_end(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)
