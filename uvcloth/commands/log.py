"""Log of the library, which commands print."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager


class PrintingHandler(logging.Handler):
    """Printing of what the library says as plain lines on stdout."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        print(self.format(record), flush=True)


@contextmanager
def printed_log() -> Iterator[None]:
    """Print what the library logs, from INFO on, while the block lasts."""
    logger, handler = logging.getLogger("uvcloth"), PrintingHandler()
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
