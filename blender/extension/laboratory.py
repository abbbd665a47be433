"""The laboratory: uvcloth itself, run as a child by a Python that has it. One child a bake, no server."""

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path


class Child:
    """A run of `uvcloth` in a process of its own; what it prints goes to a file."""

    def __init__(self, python: str, arguments: Sequence[str | Path], log: Path) -> None:
        """Begin it. Raises ValueError if that Python cannot be run."""
        self._python, self._log = python, log
        # Blender's own variables would lead another Python to Blender's packages.
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        environment |= {"PYTHONUTF8": "1", "NO_COLOR": "1", "COLUMNS": "500"}
        with log.open("wb") as output:
            try:
                self._process = subprocess.Popen(
                    [python, "-m", "uvcloth", *map(str, arguments)],
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    env=environment,
                    cwd=log.parent,
                )
            except OSError as error:
                raise ValueError(f"{python}: cannot be run ({error.strerror or error})") from error

    def is_done(self) -> bool:
        """Tell whether it has ended."""
        return self._process.poll() is not None

    def wait(self) -> None:
        """Wait until it ends."""
        self._process.wait()

    def kill(self) -> None:
        """End it now."""
        self._process.kill()
        self._process.wait()

    def last_line(self) -> str:
        """Return what it printed last, "" for nothing."""
        lines = self._log.read_text(encoding="utf-8", errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "")

    def require_success(self) -> None:
        """Raise ValueError with its sentence, if it has failed."""
        if self._process.returncode == 0:
            return
        sentence = self.last_line().removeprefix("uvcloth: ") or "it says nothing"
        if "No module named uvcloth" in sentence:
            sentence = f"{self._python} has no uvcloth: install it there, or name another Python"
        raise ValueError(sentence)
