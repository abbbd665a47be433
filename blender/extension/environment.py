"""An environment for the laboratory: venv, and pip from a folder of wheels or the package index."""

import os
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
    """Make a Python with uvcloth, from the folder of wheels, else from the package index; Esc stops"""

    bl_idname = "uvcloth.make_environment"
    bl_label = "Make One"

    def begin(self, context: Any) -> Making:
        """Start venv, then pip. Raises ValueError without wheels where Blender is offline, and OSError."""
        wheels = bpy.path.abspath(context.preferences.addons[__package__].preferences.wheels)
        if not wheels and not getattr(bpy.app, "online_access", True):
            raise ValueError("Blender is offline: allow online access there, or name a folder of wheels")
        if wheels and not Path(wheels).is_dir():
            raise ValueError(f"{wheels}: is no folder of wheels")
        folder = Path(bpy.utils.extension_path_user(__package__, path="laboratory", create=True)) / "python"
        python = folder.joinpath(*SCRIPTS)
        source = ["--no-index", "--find-links", wheels] if wheels else []
        pip = [str(python), "-m", "pip", "--no-input", "install", "--progress-bar", "off"]
        install = [*pip, *source, "uvcloth"]
        return Making(Maker(folder, [[sys.executable, "-m", "venv", str(folder)], install]), python)

    def finish(self, context: Any, errand: Making) -> None:
        """Name it in the preferences."""
        context.preferences.addons[__package__].preferences.python = str(errand.python)
