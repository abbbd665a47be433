"""A few kills of a command, as `benchmarks/kills.py` makes a hundred of each command."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

COMMANDS = ("simulate",)

LIMIT = 500
"""Seconds; a machine may be busy."""


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="forks, and looks for processes in /proc")
def test_a_killed_command_is_made_good_by_the_same_command(tmp_path: Path) -> None:
    for module in ("distributed", "lightning_fabric"):
        if find_spec(module) is None:
            pytest.skip(f"{module} is not installed")
    words = ["benchmarks/kills.py", "--times", "1", "--only", *COMMANDS]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, *words],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr.count("\t") == 4 * len(COMMANDS)
