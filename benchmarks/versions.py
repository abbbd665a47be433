"""Tests with the lowest and the newest versions of every dependency that pyproject.toml allows.

PYTHONPATH=. python benchmarks/versions.py --folder ../versions [--only newest-3.13] [--tests tests/motion]

A run that was stopped goes on with the tests that have no outcome yet: lines of FOLDER/NAME-COMMIT.jsonl.
With changes that are not committed it begins anew.

Needs uv (`pip install uv`) and the Pythons, which uv finds or brings; those of pyenv it finds with
PYENV_VERSION=3.11.7:3.12.1:3.13.0, say. Environments are made once, outside the checkout; on Linux each
takes 7 GB where only PyTorch's CUDA build is to be had.
"""

import os
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest
import tyro
from rich.console import Console
from rich.table import Table

from benchmarks.resumed import read_outcomes

ENVIRONMENTS = {
    "lowest-3.11": ("3.11", "lowest-direct"),
    "newest-3.12": ("3.12", "highest"),
    "newest-3.13": ("3.13", "highest"),
}
"""The Python of each, and how uv resolves the direct dependencies."""

TESTS = (
    "tests/rasterize",
    "tests/files",
    "tests/process",
    "tests/formats",
    "tests/geometry",
    "tests/motion/test_bvh.py",
    "tests/garments/test_loading.py",
    "tests/bodies/test_body.py",
    "tests/physics/test_judged.py",
    "tests/methods/physxnet",
    "tests/train/test_resume.py",
    "tests/writers/test_usd.py",
    "tests/writers/test_alembic.py",
    "tests/writers/test_gltf.py",
    "tests/writers/test_pictures.py",
    "tests/writers/test_embedding.py",
    "tests/view/test_page.py",
    "tests/test_checkpoint.py",
)
"""Tests that between them call every library; `--tests tests` runs all."""

SHOWN = ("torch", "numpy", "scipy", "warp-lang", "usd-core")


@dataclass(frozen=True)
class VersionsBenchmark:
    """Make the environments that are not there, and run tests in each."""

    folder: Path
    """Where the environments are kept."""
    only: tuple[str, ...] = tuple(ENVIRONMENTS)
    """Some of lowest-3.11, newest-3.12 and newest-3.13."""
    tests: tuple[str, ...] = TESTS
    """What pytest runs."""
    uv: str = "uv"
    """The program."""


def main() -> None:
    options = tyro.cli(VersionsBenchmark)
    table = Table("environment", *SHOWN, "tests", "minutes")
    for name in options.only:
        python = made(name, options)
        outcomes = options.folder.resolve() / f"{name}-{commit()}.jsonl"
        if outcomes.stem.endswith("-dirty"):
            outcomes.unlink(missing_ok=True)
        ended = run_tests(python, outcomes, options.tests)
        said, minutes = summary(outcomes)
        table.add_row(name, *versions(python), f"{said}{ended}", f"{minutes:.0f}")
    Console().print(table)


def made(name: str, options: VersionsBenchmark) -> Path:
    """The Python of an environment, which is made if it is not there."""
    version, resolution = ENVIRONMENTS[name]
    folder = options.folder / name
    python = folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    complete = folder / "complete"
    if not complete.exists():
        subprocess.run([options.uv, "venv", "--clear", "--seed", "--python", version, folder], check=True)
        wanted = ["--requirements", "pyproject.toml", "--all-extras", "--resolution", resolution]
        install: list[str | Path] = [options.uv, "pip", "install", "--python", python]
        subprocess.run([*install, *wanted], check=True)
        subprocess.run([*install, "--no-deps", "--editable", "."], check=True)
        complete.touch()
    return python


def versions(python: Path) -> list[str]:
    """Versions of the packages that are shown."""
    code = f"from importlib.metadata import version; print(*map(version, {SHOWN}))"
    answer = subprocess.run([python, "-c", code], capture_output=True, encoding="utf-8", check=True)
    return answer.stdout.split()


def commit() -> str:
    """The commit of the checkout, which ends with -dirty where files differ from it."""
    command = ["git", "describe", "--always", "--dirty", "--exclude", "*"]
    return subprocess.run(command, capture_output=True, encoding="utf-8", check=True).stdout.strip()


def run_tests(python: Path, outcomes: Path, tests: tuple[str, ...]) -> str:
    """Run the tests that have no outcome; says how pytest ended if it broke off."""
    plugin = ("-p", "benchmarks.resumed", "--outcomes", str(outcomes))
    options = ("-u", "-X", "faulthandler", "-m", "pytest", "-p", "no:cacheprovider", "-vv", "-rfE", *plugin)
    own = {"PYTHONDONTWRITEBYTECODE": "1", "PYTHONUNBUFFERED": ""}
    code = subprocess.run([python, *options, *tests], check=False, env=os.environ | own).returncode
    ended = (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED, pytest.ExitCode.NO_TESTS_COLLECTED)
    return "" if code in ended else f"; ended with {code}"


def summary(outcomes: Path) -> tuple[str, float]:
    """How many tests had each outcome, and the minutes that they took."""
    rows = list(read_outcomes(outcomes).values())
    counts = Counter(row["outcome"] for row in rows)
    said = ", ".join(f"{count} {outcome}" for outcome, count in counts.most_common())
    return said, sum(row["seconds"] for row in rows) / 60


if __name__ == "__main__":
    main()
