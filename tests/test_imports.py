"""What modules bring with them, in a process that has nothing yet."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

PROGRAM = """
import sys

def brought(*names):
    print([name for name in names if name in sys.modules])

import uvcloth
dir(uvcloth)
brought("torch", "numpy", "scipy", "warp", "tyro", "rich", "uvcloth.api")

import uvcloth.geometry.skinning
brought("kornia")

import uvcloth.api, uvcloth.rollouts.ready, uvcloth.garments.templates
import uvcloth.simulation.batch, uvcloth.simulation.run, uvcloth.commands.run.rollout
import uvcloth.wardrobe.sew, evaluate.judge, evaluate.report
brought("warp")
"""
"""Imports more and more, since to begin takes longest, and prints a line for each test."""


@pytest.fixture(scope="module")
def lines() -> list[str]:
    """What the program prints."""
    command = [sys.executable, "-c", PROGRAM]
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout.splitlines()


def test_the_public_door_loads_nothing_heavy(lines: list[str]) -> None:
    assert lines[0] == "[]"


def test_vectors_rotate_without_kornia(lines: list[str]) -> None:
    assert lines[1] == "[]"


def test_warp_is_loaded_by_training_alone(lines: list[str]) -> None:
    """It takes a second to start, which nobody who dresses or simulates a motion should wait for."""
    assert lines[2] == "[]"
