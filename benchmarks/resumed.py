"""A pytest plugin that writes the outcome of each test to a file, and leaves out the tests that are in it.

PYTHONPATH=. python -m pytest -p benchmarks.resumed --outcomes ../outcomes.jsonl

A run that is stopped goes on where it ended. A test that failed is not run again: delete its line.
"""

import json
from pathlib import Path
from typing import Any

import pytest


class Resumed:
    """The plugin: a line of the file has the name of a test, its outcome, and its seconds.

    An outcome is that of the first phase that did not pass: a fixture that fails is an error.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._outcome, self._seconds = "passed", 0.0

    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        """Leave out the tests that have an outcome."""
        done = read_outcomes(self._path)
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid in done])
        items[:] = [item for item in items if item.nodeid not in done]

    def pytest_runtest_logstart(self) -> None:
        """Begin a test."""
        self._outcome, self._seconds = "passed", 0.0

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add a phase of the test: setup, call or teardown."""
        self._seconds += report.duration
        if self._outcome == "passed" and not report.passed:
            self._outcome = "error" if report.failed and report.when != "call" else report.outcome

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        """Write the outcome of the test."""
        row = {"test": nodeid, "outcome": self._outcome, "seconds": round(self._seconds, 2)}
        with self._path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row) + "\n")


def read_outcomes(path: Path) -> dict[str, dict[str, Any]]:
    """The lines of a file by the name of their test; none where there is no file."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else ()
    return {row["test"]: row for row in map(json.loads, lines)}


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option for the file."""
    parser.addoption("--outcomes", type=Path, required=True, help="file of the outcomes")


def pytest_configure(config: pytest.Config) -> None:
    """Register the plugin."""
    config.pluginmanager.register(Resumed(config.getoption("outcomes")))
