"""The same command gives the same bytes, on any number of threads, whenever it runs."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

ROLLOUTS = """
import sys
from pathlib import Path
from uvcloth.process.command import run_command
from uvcloth.commands.run.rollout import animate
from uvcloth.commands.rollout import Rollout
from uvcloth.process.threads import limited_threads
from uvcloth.garments.cage import QUALITIES
from uvcloth.motion.options import MotionOptions

def main():
    QUALITIES["default"] = QUALITIES["fast"]
    for threads in (1, 4):
        folder, options = Path(sys.argv[1]) / str(threads), MotionOptions(frames="40:42")
        out = tuple(folder / f"walk.{suffix}" for suffix in sys.argv[2].split())
        with limited_threads(threads):
            animate(Rollout("walk", ("dress",), out, ("physxnet",), options=options))

sys.exit(run_command("rollout", main))
"""
"""One rollout, on one thread and on four, into folders of their own."""


def test_a_rollout_is_the_same_on_any_number_of_threads(tmp_path: Path) -> None:
    command = [sys.executable, "-c", ROLLOUTS, str(tmp_path), "glb usdc abc pc2 npz"]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    files = sorted((tmp_path / "1").iterdir())
    assert len(files) == 8
    for file in files:
        assert (tmp_path / "4" / file.name).read_bytes() == file.read_bytes(), file.name


PRODUCTS = """
import torch
from uvcloth.process.reproducible import fix_summation_order
fix_summation_order()
columns, rows = torch.randn(13348, 124), torch.randn(124, 24)
found = []
for threads in (1, 2, 3, 4):
    torch.set_num_threads(threads)
    found.append(columns @ rows)
assert all(torch.equal(found[0], other) for other in found)
"""


@pytest.mark.skipif("mkl" not in __import__("torch").__config__.show().lower(), reason="torch without MKL")
def test_products_are_the_same_though_torch_was_there_before() -> None:
    subprocess.run([sys.executable, "-c", PRODUCTS], cwd=ROOT, check=True)
