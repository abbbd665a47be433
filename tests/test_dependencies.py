"""Dependencies: each is declared, used and in the table of docs/dependencies.md."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from packaging.requirements import Requirement

from tests.statements import statements

ROOT = Path(__file__).parents[1]
PACKAGES = ("rasterize", "uvcloth", "train", "evaluate")

MODULES = {
    "warp-lang": "warp",
    "lightning-fabric": "lightning_fabric",
    "usd-core": "pxr",
    "pillow": "PIL",
    "scikit-learn": "sklearn",
    "scikit-image": "skimage",
    "pyyaml": "yaml",
}
"""Name to import, where it is not the package's own."""

COME_ALONG = {"imath": "alembic3d", "distributed": "dask", "websockets": "viser"}
"""Modules that another package brings, or an extra of its own."""

USED_BY_NAME = {"tensorboard", "pytest-cov", "pytest-xdist", "ruff", "mypy", "import-linter", "onnxruntime"}
"""Programs and plugins, and what a test asks for with `importorskip`."""


def requirements(groups: Iterable[str] | None = None) -> dict[str, str]:
    """Extra of each requirement by its name in lower case; "" for what is always installed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {"": project["dependencies"], **project["optional-dependencies"]}
    return {
        Requirement(line).name.lower(): extra
        for extra, lines in declared.items()
        if extra != "all" and (groups is None or extra in groups)
        for line in lines
    }


@cache
def imported(*folders: str) -> set[str]:
    """Modules of other packages that the code in folders imports."""
    found: set[str] = set()
    for path in (path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        for node in statements(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {name.name.partition(".")[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
    return found - sys.stdlib_module_names - {*PACKAGES, "tests", "benchmarks"}


def modules_of(names: Iterable[str]) -> set[str]:
    return {MODULES.get(name, name).lower() for name in names}


def test_every_dependency_is_in_the_table() -> None:
    text = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([\w-]+) \| (\w*) ?\|", text, flags=re.MULTILINE)
    table = {name.lower(): extra for name, extra in rows if name != "package" and set(name) != {"-"}}
    assert table == requirements()


def test_the_extra_all_has_every_extra_but_that_of_development() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    (itself,) = map(Requirement, extras["all"])
    assert (itself.name, itself.extras) == (project["name"], extras.keys() - {"all", "dev"})


def test_what_the_code_imports_is_declared() -> None:
    shipped = {COME_ALONG.get(name, name).lower() for name in imported(*PACKAGES)}
    # Blender's own Python has its own modules.
    assert shipped - {"bpy"} <= modules_of(name for name, extra in requirements().items() if extra != "dev")


def test_what_is_declared_is_used() -> None:
    used = {name.lower() for name in imported(*PACKAGES)}
    tested = {name.lower() for name in imported("tests")}
    for name, extra in requirements().items():
        if name not in USED_BY_NAME:
            assert modules_of([name]) <= (tested if extra == "dev" else used), f"{name} is not imported"
