"""An environment for the laboratory: made from a folder of wheels, or by a command that the user runs.

The extension itself downloads nothing, as Blender's platform asks.
"""

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from .errands import LaboratoryOperator

SCRIPTS = ("Scripts", "python.exe") if os.name == "nt" else ("bin", "python")


class Maker:
    """Commands that run one after another, the output of each in a file; `said` is its last line."""

    def __init__(self, folder: Path, commands: Sequence[Sequence[str]]) -> None:
        """Begin with the first. Raises OSError."""
        self.folder, self.said = folder, ""
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        self._waiting = list(commands)
        self._process = self._next()

    def is_done(self, wait: bool = False) -> bool:
        """Tell whether all have ended; wait: until they have. Raises ValueError if one fails."""
        while True:
            code = self._process.wait() if wait else self._process.poll()
            lines = (self.folder / "log.txt").read_text(encoding="utf-8", errors="replace").split("\n")
            self.said = next((line.strip() for line in reversed(lines) if line.strip()), self.said)
            if code is None:
                return False
            if code:
                errors = [line for line in lines if line.startswith("ERROR:")]
                self.kill()
                sentence = errors[-1].removeprefix("ERROR:").strip() if errors else self.said
                raise ValueError(f"the environment was not made ({sentence or f'exit code {code}'})")
            if not self._waiting:
                return True
            self._process = self._next()

    def kill(self) -> None:
        """End it now, and remove what was made."""
        self._process.kill()
        self._process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _next(self) -> subprocess.Popen[bytes]:
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        with (self.folder / "log.txt").open("wb") as log:
            return subprocess.Popen(
                self._waiting.pop(0), stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment
            )


@dataclass(frozen=True)
class Making:
    """An environment that is made: the Python that it will have."""

    laboratory: Maker
    python: Path


class MakeEnvironment(LaboratoryOperator, bpy.types.Operator):
    """Make a Python with uvcloth from the folder of wheels; Esc stops"""

    bl_idname = "uvcloth.make_environment"
    bl_label = "Make One"

    def begin(self, context: Any) -> Making:
        """Start venv, then pip. Raises ValueError without a folder of wheels, and OSError."""
        wheels = bpy.path.abspath(context.preferences.addons[__package__].preferences.wheels)
        if not Path(wheels or os.devnull).is_dir():
            raise ValueError(f"{wheels or 'nothing'}: is no folder of wheels, which pip takes uvcloth from")
        folder = environment_folder()
        commands = commands_in(folder, "--no-input", "--no-index", "--find-links", wheels)
        return Making(Maker(folder, commands), python_in(folder))

    def finish(self, context: Any, errand: Making) -> None:
        """Name it in the preferences."""
        context.preferences.addons[__package__].preferences.python = str(errand.python)


class CopyCommand(bpy.types.Operator):
    """Copy the command that makes a Python with uvcloth from the package index, for a terminal of yours"""

    bl_idname = "uvcloth.copy_command"
    bl_label = "Copy the Command"

    def execute(self, context: Any) -> set[str]:
        """Put it on the clipboard, and name the Python that it makes in the preferences."""
        folder = environment_folder()
        context.window_manager.clipboard = command_line(commands_in(folder))
        context.preferences.addons[__package__].preferences.python = str(python_in(folder))
        self.report({"INFO"}, "copied: run it in a terminal, which downloads uvcloth")
        return {"FINISHED"}


def environment_folder() -> Path:
    """Folder of the environment that is made."""
    return Path(bpy.utils.extension_path_user(__package__, path="laboratory", create=True)) / "python"


def python_in(folder: Path) -> Path:
    """The Python of an environment."""
    return folder.joinpath(*SCRIPTS)


def commands_in(folder: Path, *options: str) -> list[list[str]]:
    """The commands that make an environment with uvcloth. options: of pip's install."""
    pip = [str(python_in(folder)), "-m", "pip", "install", "--progress-bar", "off", *options, "uvcloth"]
    return [[sys.executable, "-m", "venv", str(folder)], pip]


def command_line(commands: Sequence[Sequence[str]]) -> str:
    """Commands as one line of a terminal, of cmd.exe on Windows."""
    join = subprocess.list2cmdline if os.name == "nt" else shlex.join
    return " && ".join(map(join, commands))
