"""What gets installed: uvcloth and rasterize with their data and the compiled runtime.

`train` and `evaluate` are inside uvcloth alone.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.wheel import ROLLOUT, SCRIPTS, build
from uvcloth.player.library import BASELINE

ROOT = Path(__file__).parents[1]
FLOORS = ("rasterize", "uvcloth")
INSIDE = ("train", "evaluate")
OBJECTS = Path("build/runtime")


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> Path:
    """A copy of the sources, since building leaves files beside them."""
    pytest.importorskip("setuptools", minversion="80")
    source = tmp_path_factory.mktemp("source")
    for name in (*FLOORS, *INSIDE, "runtime"):
        shutil.copytree(
            ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__", "libuvcloth*")
        )
    for name in ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE", "NOTICE"):
        shutil.copy(ROOT / name, source / name)
    # Objects that are of the same sources by their names are not compiled again.
    if (ROOT / OBJECTS).exists():
        shutil.copytree(ROOT / OBJECTS, source / OBJECTS)
    return source


@pytest.fixture(scope="module")
def wheel(source) -> Path:
    return build("wheel", source, source / "wheel")


@pytest.fixture(scope="module")
def wheel_names(wheel) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def test_the_wheel_holds_the_two_floors_only(wheel_names):
    tops = {name.split("/")[0] for name in wheel_names}
    assert {top for top in tops if not top.endswith(".dist-info")} == set(FLOORS)


def test_the_wheel_holds_every_module_and_all_data(wheel_names):
    sources = {path for top in (*FLOORS, *INSIDE) for path in (ROOT / top).rglob("*") if path.is_file()}
    names = {path.relative_to(ROOT).as_posix() for path in sources if path.suffix != ".pyc"}
    installed = {f"uvcloth/{name}" if name.startswith(INSIDE) else name for name in names}
    assert not installed - wheel_names


@pytest.mark.thorough
def test_the_installed_wheel_works_from_another_folder(wheel, tmp_path):
    """With the packages of this environment; `python -m tests.wheel` installs those of the wheel."""
    venv, away = tmp_path / "venv", tmp_path / "away"
    away.mkdir()
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True)
    library = Path(sysconfig.get_path("purelib", vars={"base": str(venv), "platbase": str(venv)}))
    (library / "others.pth").write_text(sysconfig.get_path("purelib"))
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        venv,
        "install",
        "--no-deps",
        "--no-index",
        "--no-compile",
    ]
    # On PYTHONPATH pip would find the metadata of an unpacked source distribution, and install nothing.
    variables = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    subprocess.run([*pip, wheel], env=variables, check=True, capture_output=True)
    (version,) = wheel.name.split("-")[1:2]

    def printed(command: str) -> str:
        words = [venv / SCRIPTS / "uvcloth", *command.split()[1:]]
        done = subprocess.run(words, cwd=away, env=variables, check=True, capture_output=True, text=True)
        return done.stdout

    assert printed("uvcloth --version") == f"uvcloth {version}\n"
    assert "physxnet" in printed("uvcloth train --help")
    assert "--predicted" in printed("uvcloth evaluate --help")
    assert "4 frames" in printed(f"{ROLLOUT} walk.glb")
    assert (away / "walk.glb").stat().st_size > 10_000


def test_the_wheel_holds_the_runtime_for_every_python_of_one_platform(wheel, wheel_names):
    assert wheel.name.split("-")[2:4] == ["py3", "none"]
    assert not wheel.stem.endswith("-any")
    assert f"uvcloth/player/{BASELINE}" in wheel_names


def test_the_source_distribution_holds_the_runtime_and_nothing_compiled(source, wheel):
    with tarfile.open(build("sdist", source, source / "sdist")) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    runtime = {path.relative_to(ROOT).as_posix() for path in (ROOT / "runtime").rglob("*") if path.is_file()}
    assert {name for name in runtime if not name.endswith(".pyc")} <= names
    assert not [name for name in names if "libuvcloth" in name]


def test_the_wheel_says_that_it_is_typed(wheel_names):
    assert {f"{floor}/py.typed" for floor in FLOORS} <= wheel_names


def test_the_wheel_carries_the_licence_and_the_notice(wheel_names):
    assert {name.rsplit("/", 1)[-1] for name in wheel_names if "/licenses/" in name} >= {"LICENSE", "NOTICE"}


def test_requirements_admit_the_pinned_versions():
    pinned = dict(
        line.split("==") for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line
    )
    pinned = {name.lower().replace("_", "-"): version for name, version in pinned.items()}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    for requirement in map(Requirement, chain(project["dependencies"], *extras)):
        name = requirement.name.lower().replace("_", "-")
        if name == project["name"]:
            continue
        assert name in pinned, f"{requirement.name} is not pinned in constraints.txt"
        assert requirement.specifier.contains(pinned[name]), f"{requirement} does not admit {pinned[name]}"


def test_the_data_of_the_package_stay_small() -> None:
    data = ROOT / "uvcloth" / "data"
    files = [path for path in data.rglob("*") if path.is_file()]
    sizes = {path.relative_to(data): path.stat().st_size for path in files}
    assert len(sizes) > 10
    models = sum(size for path, size in sizes.items() if {"models", "wrinkles"} & {*path.parts})
    assert models < 20e6
    assert sum(sizes.values()) - models < 3.5e6
