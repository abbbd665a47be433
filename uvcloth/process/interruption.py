"""Ctrl-C and SIGTERM: both end a command cleanly, and soon."""

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)

SECONDS = 1.5
"""Time for a command to end by itself after it was interrupted."""


@contextmanager
def interruptible(last_words: Callable[[int], bytes]) -> Iterator[None]:
    """End the process when the block is left after Ctrl-C or SIGTERM, or SECONDS after them.

    Both raise KeyboardInterrupt in the block. last_words: is given the exit code, 130 or 143, and returns
    text for stderr. A thread counts the seconds, as the main one may be in a long computation; nothing that
    is registered for the end of Python runs. Outside of the main thread, which alone hears of signals,
    nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Of semaphores that the process leaves, Python's tracker of them clears the last, and warns.
    os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker")
    # On Windows signals are written to sockets only. Both stay open: a second signal may come at any time.
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    threading.Thread(target=_count_down, args=(receiver, last_words), daemon=True).start()
    received: list[int] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        received.append(number)
        raise KeyboardInterrupt

    heard = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, interrupt) for number in heard}
    wakeup = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
    try:
        yield
    except BaseException:
        if received:
            sys.stdout.flush()
            _end(received[0], last_words)
        raise
    else:
        # Ctrl-C may be how a command ends well, and is caught; SIGTERM never is.
        if signal.SIGTERM in received:
            sys.stdout.flush()
            _end(signal.SIGTERM, last_words)
    finally:
        if not received:
            signal.set_wakeup_fd(wakeup)
            for number, handler in before.items():
                signal.signal(number, handler)
            sender.close()


@contextmanager
def uninterrupted() -> Iterator[Callable[[], bool]]:
    """Hold back the first Ctrl-C or SIGTERM until the block ends, which is given whether there was one.

    A second one interrupts at once. Outside of the main thread nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    noted: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        noted.append(number)
        restore()

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    heard = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, note) for number in heard}
    try:
        yield lambda: bool(noted)
    finally:
        restore()
    if noted:
        signal.raise_signal(noted[0])


def _count_down(receiver: socket.socket, last_words: Callable[[int], bytes]) -> None:
    """End the process some time after the first byte that is the number of a signal of SIGNALS."""
    while (number := receiver.recv(1)) and number[0] not in SIGNALS:
        continue
    if number:
        time.sleep(SECONDS)
        _end(number[0], last_words)
    receiver.close()


def _end(number: int, last_words: Callable[[int], bytes]) -> None:
    os.write(2, last_words(128 + number))
    os._exit(128 + number)
