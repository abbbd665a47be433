"""What gets installed: uvcloth and rasterize with their data, and never `train` or `evaluate`."""

import shutil
import subprocess
import sys
import tomllib
import zipfile
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
FLOORS = ("rasterize", "uvcloth")


@pytest.fixture(scope="module")
def wheel_names(tmp_path_factory) -> set[str]:
    """Names in a wheel built from a copy of the sources, since building leaves files beside them."""
    pytest.importorskip("setuptools", minversion="80")
    source = tmp_path_factory.mktemp("source")
    for name in ("uvcloth", "rasterize", "train", "evaluate"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE", "NOTICE"):
        shutil.copy(ROOT / name, source / name)
    build = "import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])"
    target = source / "wheel"
    target.mkdir()
    subprocess.run([sys.executable, "-c", build, target], cwd=source, check=True, capture_output=True)
    (wheel,) = target.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def test_the_wheel_holds_the_two_floors_only(wheel_names):
    tops = {name.split("/")[0] for name in wheel_names}
    assert {top for top in tops if not top.endswith(".dist-info")} == set(FLOORS)


def test_the_wheel_holds_every_module_and_all_data(wheel_names):
    sources = {path for floor in FLOORS for path in (ROOT / floor).rglob("*") if path.is_file()}
    missing = {str(path.relative_to(ROOT)) for path in sources if path.suffix != ".pyc"} - wheel_names
    assert not missing


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
    sizes = {path: path.stat().st_size for path in (ROOT / "uvcloth" / "data").rglob("*") if path.is_file()}
    assert len(sizes) > 10
    assert sum(sizes.values()) < 20e6
