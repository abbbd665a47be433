"""Ctrl-C and SIGTERM: both end a command cleanly, and soon."""

import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)

SECONDS = 1.5
"""Time for a command to end by itself after it was interrupted."""


class Terminated(KeyboardInterrupt):
    """SIGTERM, raised as Ctrl-C is."""


@contextmanager
def interruptible(last_words: Callable[[int], bytes]) -> Iterator[None]:
    """Raise Terminated on SIGTERM, and end the process at the latest SECONDS after it or Ctrl-C.

    last_words: is given the exit code that then is used, and returns text for stderr. A thread counts the
    seconds, as the main one may be in a long computation. Outside of the main thread, which alone hears of
    signals, nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # On Windows signals are written to sockets only.
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    threading.Thread(target=_count_down, args=(receiver, last_words), daemon=True).start()
    terminate = signal.signal(signal.SIGTERM, _terminate)
    wakeup = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(wakeup)
        signal.signal(signal.SIGTERM, terminate)
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


def _terminate(number: int, frame: FrameType | None) -> None:
    raise Terminated


def _count_down(receiver: socket.socket, last_words: Callable[[int], bytes]) -> None:
    """End the process some time after the first byte that is the number of a signal of SIGNALS."""
    with receiver:
        while (number := receiver.recv(1)) and number[0] not in SIGNALS:
            continue
    if number:
        time.sleep(SECONDS)
        os.write(2, last_words(128 + number[0]))
        os._exit(128 + number[0])
