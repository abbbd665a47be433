"""The laboratory: uvcloth itself, run as a child by a Python that has it; it dies with Blender.

One child serves all that is asked, so that what it knows of a character stays: `uvcloth serve --stdio`.
"""

import json
import os
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import IO, Any

PROTOCOL = 1
"""Version of what is said."""


class Laboratory:
    """A running `uvcloth serve --stdio`, and the folder of the files that go to it and come from it."""

    def __init__(self, python: str) -> None:
        """Begin it. Raises ValueError if that Python cannot be run, OSError if no folder can be made."""
        self.python, self.said = python, ""
        self._keeper = tempfile.TemporaryDirectory(prefix="uvcloth-", ignore_cleanup_errors=True)
        self.folder = Path(self._keeper.name)
        # Blender's own variables would lead another Python to Blender's packages.
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        environment |= {"PYTHONUTF8": "1", "NO_COLOR": "1", "COLUMNS": "500"}
        with (self.folder / "log.txt").open("wb") as log:
            try:
                self._process = subprocess.Popen(
                    [python, "-m", "uvcloth", "serve", "--stdio"],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=log,
                    env=environment,
                    cwd=self.folder,
                )
            except OSError as error:
                self._keeper.cleanup()
                raise ValueError(f"{python}: cannot be run ({error.strerror or error})") from error
        self._messages: SimpleQueue[dict[str, Any] | None] = SimpleQueue()
        threading.Thread(target=_read, args=(self._process.stdout, self._messages), daemon=True).start()

    def begin(self, words: Sequence[str | Path]) -> None:
        """Ask for a command."""
        self.said = ""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps({"run": [str(word) for word in words]}).encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            pass  # It has ended; is_done says why.

    def is_done(self, wait: bool = False) -> bool:
        """Tell whether the command has ended; wait: until it has. `said` is its last line so far.

        Raises ValueError with its sentence if it was refused, and if the laboratory has ended.
        """
        while True:
            try:
                message = self._messages.get(block=wait)
            except Empty:
                return False
            if message is None:
                raise ValueError(self._why_ended())
            if "done" in message:
                return True
            if "refused" in message:
                raise ValueError(str(message["refused"]))
            if "uvcloth" in message and message.get("protocol") != PROTOCOL:
                self.kill()
                raise ValueError(
                    f"{self.python} has uvcloth {message['uvcloth']}, which is not for this version of the "
                    "extension: install the same one there"
                )
            self.said = str(message.get("says", "")).strip() or self.said

    def runs(self) -> bool:
        """Tell whether the child is there."""
        return self._process.poll() is None

    def kill(self) -> None:
        """End it now, and remove its files."""
        self._process.kill()
        self._process.wait()
        self._keeper.cleanup()

    def _why_ended(self) -> str:
        """One sentence on why the child is not there any more."""
        code = self._process.wait()
        log = self.folder / "log.txt"
        lines = log.read_text(encoding="utf-8", errors="replace").split("\n") if log.exists() else []
        sentence = next((line.strip() for line in reversed(lines) if line.strip()), "")
        if "No module named uvcloth" in sentence:
            return f"{self.python} has no uvcloth: install it there, or name another Python"
        if "invalid choice" in "".join(lines):
            return f"the uvcloth of {self.python} is older than this extension: install a newer one there"
        return f"the laboratory has ended ({sentence.removeprefix('uvcloth: ') or f'exit code {code}'})"


def _read(stream: IO[bytes], messages: SimpleQueue[dict[str, Any] | None]) -> None:
    """Hand on what the child says, then None."""
    for line in stream:
        try:
            messages.put(dict(json.loads(line)))
        except ValueError:
            continue  # What another program of that name prints.
    messages.put(None)


class _Kept:
    """The laboratory of this Blender."""

    laboratory: Laboratory | None = None


def laboratory_of(python: str) -> Laboratory:
    """The laboratory that runs, or a new one. Raises ValueError if that Python cannot be run, and OSError."""
    laboratory = _Kept.laboratory
    if laboratory is None or laboratory.python != python or not laboratory.runs():
        close()
        laboratory = _Kept.laboratory = Laboratory(python)
    return laboratory


def close() -> None:
    """End the laboratory, if it runs."""
    if _Kept.laboratory is not None:
        _Kept.laboratory.kill()
        _Kept.laboratory = None
