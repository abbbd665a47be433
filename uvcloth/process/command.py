"""Exit codes and messages of every command: one sentence for bad input, never a traceback for it."""

import errno
import io
import os
import re
import sys
from collections.abc import Callable

from uvcloth.errors import InputError
from uvcloth.process.interruption import interruptible
from uvcloth.process.reproducible import fix_summation_order

BAD_INPUT, INTERRUPTED, UNREAD, TERMINATED = 2, 130, 141, 143

ENDED = {
    INTERRUPTED: "interrupted; finished work is in place",
    TERMINATED: "terminated; finished work is in place",
}

REFUSED_BY_THE_SYSTEM = {
    *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.ENAMETOOLONG)
}
"""Errors of the system, not of the program: full disk, quota, read-only folder, no permission, long name."""

LONGEST = 600
"""Characters of a sentence; of a longer one the middle is left out."""

PARTIAL = re.compile(r"\.([^/\\]+)\.partial([/\\][^\s:]*)?")
"""Path of an unfinished file, hidden beside the one to be."""


def run_command(program: str, command: Callable[[], None]) -> int:
    """Run a command and return its exit code: `sys.exit(run_command("uvcloth", main))`.

    0 when it returns; 2 with the sentence of an InputError, or of a disk that is full or refuses, on
    stderr; 130 after Ctrl-C, 143 after SIGTERM, when the process ends within two seconds (see
    `interruptible`); 141, silently, when the output is closed (`| head`). Any other exception is
    a bug and keeps its traceback.
    """
    fix_summation_order()
    _print_any_name()
    try:
        with interruptible(lambda code: f"{_line(program, ENDED[code])}\n".encode()):
            try:
                command()
            finally:
                sys.stdout.flush()
    except InputError as error:
        return _report(program, str(error), BAD_INPUT)
    except KeyboardInterrupt:
        return _report(program, ENDED[INTERRUPTED], INTERRUPTED)
    except BrokenPipeError:
        # The interpreter flushes stdout once more when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    except OSError as error:
        return _report(program, refusal(error), BAD_INPUT)
    return 0


def refusal(error: OSError) -> str:
    """Say in one sentence that a disk is full, or that the system refuses. Raises any other error again."""
    if error.errno not in REFUSED_BY_THE_SYSTEM:
        raise error
    place = f"{error.filename}: " if error.filename else ""
    return f"{place}cannot be written or read ({error.strerror})"


def _print_any_name() -> None:
    """Have names printed with backslashes where the terminal's encoding lacks a letter, not refused."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _report(program: str, sentence: str, code: int) -> int:
    """Print one sentence to stderr, on one line, and return the exit code."""
    print(_line(program, sentence), file=sys.stderr)
    return code


def one_line(sentence: str) -> str:
    """A sentence on one line, cut to LONGEST characters, without paths of unfinished files."""
    text = PARTIAL.sub(r"\1", " ".join(sentence.split()))
    return text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} ... {text[-LONGEST // 2 :]}"


def _line(program: str, sentence: str) -> str:
    return f"{program}: {one_line(sentence)}"
