"""What an artist does, done once in Blender for all tests of the extension."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest

from tests.glb_json import edited
from uvcloth.commands.bake import Bake
from uvcloth.commands.run.bake import bake
from uvcloth.player.baked import EXTENSION

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


@dataclass(frozen=True)
class Done:
    """Results: arrays and words by name, and the folder of the files."""

    arrays: dict[str, np.ndarray]
    said: dict[str, Any]
    folder: Path


def load_module(name: str, path: Path) -> ModuleType:
    """A module of a file outside of the packages."""
    spec = spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def blender_python() -> str:
    """A Python with bpy."""
    python = os.environ.get("UVCLOTH_BLENDER_PYTHON")
    if not python:
        pytest.skip("needs UVCLOTH_BLENDER_PYTHON, a Python that has the package bpy")
    return python


@pytest.fixture(scope="session")
def extension(blender_python: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The extension for this system."""
    folder = tmp_path_factory.mktemp("extension")
    command = [sys.executable, str(ROOT / "blender" / "build.py"), str(folder)]
    subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
    (path,) = folder.glob("*.zip")
    return path


@pytest.fixture(scope="session")
def baked(blender_python: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A baked dress that walks."""
    path = tmp_path_factory.mktemp("baked") / "baked.glb"
    bake(Bake(garment=("dress",), out=path, motion="walk", quality="fast"))
    return path


@pytest.fixture(scope="session")
def done(blender_python: str, extension: Path, baked: Path, tmp_path_factory: pytest.TempPathFactory) -> Done:
    """What in_blender.py does."""
    folder = tmp_path_factory.mktemp("blender")
    _write_bad_files(baked, folder)
    _write_wheel(folder / "wheels")
    return run_in_blender(blender_python, "in_blender.py", extension, baked, folder)


def run_in_blender(python: str, script: str, *arguments: Path) -> Done:
    """Run a script of this folder by a Python with bpy; the last argument is the folder that it writes to."""
    folder = arguments[-1]
    # Its Python must not find our packages, nor Blender what the user has.
    clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    clean["BLENDER_USER_RESOURCES"] = str(folder / "user")
    command = [python, str(HERE / script), *map(str, arguments)]
    done = subprocess.run(command, check=False, capture_output=True, encoding="utf-8", env=clean, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    with np.load(folder / "arrays.npz") as file:
        arrays = {name: file[name] for name in file.files}
    return Done(arrays, json.loads((folder / "said.json").read_text(encoding="utf-8")), folder)


def _write_wheel(folder: Path) -> None:
    """Write a wheel that has the name of ours, and nothing that takes time."""
    folder.mkdir()
    inside = {
        "uvcloth.py": "",
        "uvcloth-0.2.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: uvcloth\nVersion: 0.2.0\n",
        "uvcloth-0.2.0.dist-info/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        "uvcloth-0.2.0.dist-info/RECORD": "",
    }
    with ZipFile(folder / "uvcloth-0.2.0-py3-none-any.whl", "w") as wheel:
        for name, content in inside.items():
            wheel.writestr(name, content)


def _write_bad_files(baked: Path, folder: Path) -> None:
    """Write files that cannot be opened, and one without a motion."""

    def without_cloth(document: dict[str, Any]) -> None:
        del document["extensions"]

    def still(document: dict[str, Any]) -> None:
        del document["animations"]

    def frameless(document: dict[str, Any]) -> None:
        document["animations"] = [{"channels": [], "samplers": []}]

    def older(document: dict[str, Any]) -> None:
        document["extensions"][EXTENSION]["version"] = 0

    def newer(document: dict[str, Any]) -> None:
        document["extensions"][EXTENSION]["version"] = 2

    def nameless(document: dict[str, Any]) -> None:
        for node in document["nodes"]:
            node.pop("name", None)

    def misplaced(document: dict[str, Any]) -> None:
        document["extensions"][EXTENSION]["garments"][0]["node"] = 0

    content = baked.read_bytes()
    (folder / "bad_cut.glb").write_bytes(content[:20_000])
    (folder / "still.glb").write_bytes(edited(content, still))
    for change in (without_cloth, older, newer, frameless, nameless, misplaced):
        (folder / f"bad_{change.__name__}.glb").write_bytes(edited(content, change))
