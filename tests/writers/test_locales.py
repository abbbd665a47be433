"""Files are the same where a comma is the decimal point, and where the small I has no dot."""

import locale
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.motion.bvh_text import bvh_text, performer, still
from tests.writers.test_writer import write
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.motion.bvh import read_bvh
from uvcloth.writers.animation import Animation

FOREIGN = ("tr_TR", pytest.param("de_DE", marks=pytest.mark.thorough))
"""Turkish has both, the comma and the letter."""

FRAMES = 3


@pytest.fixture(scope="module", params=FOREIGN)
def installed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """Name of a locale, and the folder of it where the system has its source but not itself."""
    name, folder = f"{request.param}.UTF-8", tmp_path_factory.mktemp("locales")
    before = locale.setlocale(locale.LC_ALL)
    try:
        locale.setlocale(locale.LC_ALL, name)
        locale.setlocale(locale.LC_ALL, before)
    except locale.Error:
        tool = shutil.which("localedef")
        if tool is None:
            pytest.skip(f"the system has neither the locale {name} nor localedef to make it")
        command = [tool, "-i", request.param, "-f", "UTF-8", folder / name]
        subprocess.run(command, check=False, capture_output=True)
        if not (folder / name).is_dir():
            pytest.skip(f"the system has neither the locale {name} nor its source")
    return name, folder


@pytest.fixture
def foreign(installed: tuple[str, Path], monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Name of a locale that the test may set."""
    name, folder = installed
    before = locale.setlocale(locale.LC_ALL)
    if (folder / name).is_dir():
        monkeypatch.setenv("LOCPATH", str(folder))
    yield name
    locale.setlocale(locale.LC_ALL, before)


@pytest.fixture(scope="module")
def usual(animation: Animation, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files as the usual locale writes them."""
    pytest.importorskip("alembic3d", reason="alembic3d is not installed")
    return written(animation, tmp_path_factory.mktemp("usual") / "files")


def written(animation: Animation, folder: Path) -> dict[str, bytes]:
    """The files of the first frames, by their names."""
    folder.mkdir()
    vertices = tuple(each[:FRAMES] for each in animation.vertices)
    animation = replace(animation, vertices=vertices, transforms=animation.transforms[:FRAMES])
    for suffix in (".abc", ".glb", ".usdc", ".pc2", ".obj"):
        write(animation, folder / f"walk{suffix}")
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.thorough
def test_files_are_written_alike(
    animation: Animation, usual: dict[str, bytes], foreign: str, tmp_path: Path
) -> None:
    locale.setlocale(locale.LC_ALL, foreign)
    assert locale.str(0.5) == "0,5"
    found = written(animation, tmp_path / "foreign")
    assert found.keys() == usual.keys()
    assert [name for name, content in found.items() if content != usual[name]] == []


def test_files_are_read_alike(foreign: str, tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.123456)
    for kind, options in (("obj", {}), ("ply", {"encoding": "ascii"}), ("stl_ascii", {}), ("off", {})):
        content = ball.export(file_type=kind, **options)
        (tmp_path / f"a.{kind[:3]}").write_bytes(content if isinstance(content, bytes) else content.encode())
    joints = performer()
    (tmp_path / "a.bvh").write_text(bvh_text(joints, still(joints, 3) + 0.25))
    usual = [read_mesh(tmp_path / f"a.{kind}").vertices for kind in ("obj", "ply", "stl", "off")]
    clip = read_bvh(tmp_path / "a.bvh")
    locale.setlocale(locale.LC_ALL, foreign)
    found = [read_mesh(tmp_path / f"a.{kind}").vertices for kind in ("obj", "ply", "stl", "off")]
    assert all(map(np.array_equal, usual, found))
    assert np.array_equal(read_bvh(tmp_path / "a.bvh").rotations, clip.rotations)
