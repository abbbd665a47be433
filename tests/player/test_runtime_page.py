"""The program of docs/runtime.md, which plays an outfit in C: it compiles, and gives what Python does."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from tests.player.system_compiler import compiler
from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Outfit as WornOutfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.physics.outfit import PhysicsConfig, bake_outfit
from uvcloth.motion.library import load_clip
from uvcloth.player.library import library
from uvcloth.player.outfit import Cloth, Outfit

ROOT = Path(__file__).parents[2]
LONGEST = 60
"""Lines of the program at most."""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The compiled program."""
    system = compiler("CC", "cc", "gcc", "clang")
    if not system:
        pytest.skip("the system has no C compiler")
    page = (ROOT / "docs" / "runtime.md").read_text(encoding="utf-8")
    (source,) = re.findall(r"^```c\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert source.count("\n") <= LONGEST
    folder = tmp_path_factory.mktemp("program")
    (folder / "play.c").write_text(source, encoding="utf-8")
    loaded = Path(library()._name)
    command = [
        *(*system, "-std=c99", "-Wall", "-Wextra", "-Werror", f"-I{ROOT / 'runtime' / 'include'}"),
        *(folder / "play.c", loaded, f"-Wl,-rpath,{loaded.parent}", "-o", folder / "play"),
    ]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert not done.returncode, done.stderr
    return folder / "play"


@pytest.fixture(scope="module")
def content(body: Body) -> bytes:
    return bake_outfit(WornOutfit(body, (fit_template("skirt", body),)), PhysicsConfig("fast"))


@pytest.fixture(scope="module")
def motion(body: Body) -> NDArray[np.float64]:
    return np.asarray(load_clip("walk", body).transforms(torch.float64).numpy()[:8])


def test_the_program_gives_the_vertices_that_python_does(
    program: Path, content: bytes, motion: NDArray[np.float64], tmp_path: Path
) -> None:
    (tmp_path / "hero.cloth").write_bytes(content)
    motion.tofile(tmp_path / "hero.motion")
    command = [program, *(tmp_path / f"hero.{end}" for end in ("cloth", "motion", "vertices"))]
    subprocess.run(command, check=True)
    found = np.fromfile(tmp_path / "hero.vertices").reshape(len(motion), -1, 3)
    cloth = Cloth(Outfit(content))
    cloth.start(motion[0])
    for joints, vertices in zip(motion, found, strict=True):
        cloth.step(joints, 1.0 / 30.0)
        np.testing.assert_array_equal(vertices, cloth.vertices(0))


def test_the_program_says_what_is_wrong(
    program: Path, content: bytes, motion: NDArray[np.float64], tmp_path: Path
) -> None:
    (tmp_path / "hero.cloth").write_bytes(content[:-1])
    motion.tofile(tmp_path / "hero.motion")
    command = [program, *(tmp_path / f"hero.{end}" for end in ("cloth", "motion", "vertices"))]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, "the outfit is cut or damaged\n")
