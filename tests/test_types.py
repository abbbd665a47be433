"""The types of the public door, as a type checker of its users sees them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

USER = """
import numpy as np
import uvcloth

body = uvcloth.load_body()
motion = uvcloth.load_motion(np.zeros((1, 163, 4, 4)), body, fps=60)
outfit = uvcloth.fit(["bottoms", (np.zeros((3, 3)), np.zeros((1, 3), dtype=int))], body, fabric="silk")
reveal_type(uvcloth.rollout("physxnet", motion, outfit))
reveal_type(uvcloth.rollout_frames(uvcloth.load_model(), "walk", outfit))
reveal_type(uvcloth.export(uvcloth.simulate(motion, "dress"), "out.glb"))
reveal_type(uvcloth.__version__)
uvcloth.InputError("")
uvcloth.load_motion("walk", body, fps="fast")
uvcloth.rolout
"""

TRUE_TYPES = (
    'Revealed type is "uvcloth.writers.animation.Animation"',
    'Revealed type is "typing.Iterator[uvcloth.rollouts.rollout.RolloutFrame]"',
    'Revealed type is "tuple[pathlib.Path, ...]"',
    'Revealed type is "str"',
    'Argument "fps" to "load_motion" has incompatible type "str"; expected "float"',
    'Module has no attribute "rolout"; maybe "rollout"?',
)


@pytest.mark.thorough
def test_a_type_checker_sees_the_types(tmp_path: Path) -> None:
    """With the settings of `make lint`, whose cache is used where there is one.

    NumPy's own types have errors in versions that are newer than the Python of these settings.
    """
    pytest.importorskip("mypy", reason="mypy is not installed")
    user = tmp_path / "user.py"
    user.write_text(USER, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--no-error-summary", str(user)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=ROOT)
    # The cache repeats what was said of the same file in the folder of an earlier run.
    lines = [line for line in done.stdout.splitlines() if f"{os.sep}{user.name}:" in line]
    # Older versions write builtins.tuple.
    found = [line.partition(": ")[2].replace("builtins.", "") for line in lines]
    assert len(found) == len(TRUE_TYPES), done.stdout + done.stderr
    for line, expected in zip(found, TRUE_TYPES, strict=True):
        assert expected in line
