"""Commands that are run one after another for another program, over two streams, a JSON object a line.

    this program    {"uvcloth": "0.2.0", "protocol": 1}
    the other       {"run": ["bake", "--body", "hero.glb", "--garment", "skirt.obj", "--out", "out.glb"]}
    this program    {"says": "..."}        as often as the command prints a line
                    {"done": true}         or {"refused": "one sentence"}

What is imported and what is known of a character stays from run to run. When the other program closes its
end, or dies, this process ends at once, also in the middle of a command.
"""

import io
import json
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from queue import SimpleQueue
from typing import IO, Any, cast

from tyro.extras import subcommand_cli_from_dict

from uvcloth.commands.bake import Bake
from uvcloth.commands.log import printed_log
from uvcloth.commands.rest import Rest
from uvcloth.commands.serve import Serve
from uvcloth.errors import InputError
from uvcloth.files.options import parsed
from uvcloth.process.command import one_line, refusal
from uvcloth.version import package_version

PROTOCOL = 1
"""Version of what is said over the streams."""

SERVED: dict[str, Callable[..., Bake | Rest]] = {"bake": Bake, "rest": Rest}
"""Commands that are run, by name."""

LONGEST_REQUEST = 1_000_000
"""Bytes of a line that is read."""


def run(_: Serve) -> None:
    """Serve over the standard streams, until the input ends; then the process ends.

    What libraries print to the standard output goes to the standard error.
    """
    requests, answers = os.dup(0), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)

    def send(message: dict[str, Any]) -> None:
        answers.write(json.dumps(message).encode() + b"\n")
        answers.flush()

    send({"uvcloth": package_version(), "protocol": PROTOCOL})
    for line in _lines(os.fdopen(requests, "rb")):
        send(answer(line, lambda text: send({"says": text})))


def answer(line: bytes, says: Callable[[str], None]) -> dict[str, Any]:
    """Run a request, and return the answer. says: is called with each line that the command prints."""
    printed = cast(IO[str], _Printed(says))
    try:
        with redirect_stdout(printed), redirect_stderr(printed), printed_log():
            _command(_words(line)).run()
    except InputError as error:
        return {"refused": one_line(str(error))}
    except OSError as error:
        return {"refused": one_line(refusal(error))}
    return {"done": True}


def _words(line: bytes) -> Sequence[str]:
    """The command line of a request. Raises InputError for what is none."""
    try:
        request = json.loads(line)
        words = request["run"]
        if not all(isinstance(word, str) for word in words) or words[0] not in SERVED:
            raise ValueError
    except (ValueError, TypeError, KeyError, IndexError, RecursionError) as error:
        expected = f'{{"run": ["{"|".join(SERVED)}", ...]}}'
        raise InputError(f"expected a line {expected}, not {line[:80]!r}") from error
    return list(words)


def _command(words: Sequence[str]) -> Bake | Rest:
    """The command of a command line. Raises InputError for options that it does not have."""
    try:
        return parsed(lambda: subcommand_cli_from_dict(SERVED, prog="uvcloth", args=words), words)
    except SystemExit as error:
        raise InputError(f"{words[0]}: its options are not understood, see the lines before") from error


def _lines(stream: IO[bytes]) -> Iterator[bytes]:
    """Lines as they come, read by a thread that ends the process at the end of the stream."""
    waiting: SimpleQueue[bytes] = SimpleQueue()

    def read() -> None:
        while line := stream.readline(LONGEST_REQUEST):
            waiting.put(line)
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    while True:
        yield waiting.get()


class _Printed(io.TextIOBase):
    """A stream that hands on what is printed, line by line."""

    encoding = "utf-8"

    def __init__(self, says: Callable[[str], None]) -> None:
        self._says, self._started = says, ""

    def writable(self) -> bool:
        """Tell that one can write to it."""
        return True

    def write(self, text: str) -> int:
        """Hand on the lines that are complete."""
        *lines, self._started = (self._started + text).replace("\r", "\n").split("\n")
        for line in lines:
            if line.strip():
                self._says(line)
        return len(text)
