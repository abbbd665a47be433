"""A run of tests that goes on where it was stopped."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.resumed import read_outcomes

TESTS = """
import pytest

@pytest.fixture
def broken():
    raise ValueError

def test_passes():
    pass

def test_fails():
    assert False

def test_stands_on_a_broken_fixture(broken):
    pass

@pytest.mark.skip
def test_is_skipped():
    pass

def test_ends_the_process():
    import os
    if os.environ["KILLED"]:
        os._exit(9)
"""

OUTCOMES = {
    "test_passes": "passed",
    "test_fails": "failed",
    "test_stands_on_a_broken_fixture": "error",
    "test_is_skipped": "skipped",
}


def run(folder: Path, killed: str) -> tuple[dict[str, str], str]:
    """Outcomes by the name of the test, and what pytest printed."""
    plugin = ("-p", "benchmarks.resumed", "--outcomes", "outcomes.jsonl", "-p", "no:cacheprovider")
    command = [sys.executable, "-m", "pytest", "-c", os.devnull, "--rootdir", ".", *plugin, "test_few.py"]
    variables = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1]), "KILLED": killed}
    done = subprocess.run(command, cwd=folder, env=variables, check=False, capture_output=True, text=True)
    rows = read_outcomes(folder / "outcomes.jsonl")
    return {name.partition("::")[2]: row["outcome"] for name, row in rows.items()}, done.stdout


@pytest.mark.thorough
def test_tests_that_have_an_outcome_are_not_run_again(tmp_path: Path) -> None:
    (tmp_path / "test_few.py").write_text(TESTS)
    outcomes, _ = run(tmp_path, killed="yes")
    assert outcomes == OUTCOMES
    outcomes, said = run(tmp_path, killed="")
    assert outcomes == {**OUTCOMES, "test_ends_the_process": "passed"}
    assert "1 passed, 4 deselected" in said
