"""How the runtime is compiled: with the system's compiler or by ziglang, once, and for uvcloth-core too."""

import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

from uvcloth.player.library import BASELINE, FOLDER

ROOT = Path(__file__).parents[2]

PLAYED = """
import sys
from uvcloth_core.library import library
from uvcloth_core.sections import pack
library()
assert not {"uvcloth", "torch"} & set(sys.modules)
"""


@pytest.fixture
def compiling(monkeypatch) -> ModuleType:
    monkeypatch.syspath_prepend(ROOT / "runtime")
    return import_module("compile")


def test_ziglang_is_installed_only_where_there_is_no_compiler(compiling, monkeypatch) -> None:
    backend = import_module("backend")
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("CXX", f"{sys.executable} -flag")
    assert compiling.system_compiler() == [sys.executable, "-flag"]
    assert compiling.requirements() == []
    monkeypatch.delenv("CXX")
    monkeypatch.setenv("PATH", "")
    assert compiling.requirements() == [compiling.ZIGLANG]
    asked = compiling.ZIGLANG, backend.build_meta
    monkeypatch.setattr(backend.build_meta, "get_requires_for_build_wheel", lambda settings: ["other"])
    monkeypatch.setattr(backend.build_meta, "get_requires_for_build_editable", lambda settings: ["other"])
    assert backend.get_requires_for_build_wheel() == ["other", asked[0]]
    assert backend.get_requires_for_build_editable() == ["other", asked[0]]


@pytest.mark.parametrize("name", ["meshes", "outfit", "sections", "skeleton"])
def test_what_make_sanitize_compiles_fits_the_headers(compiling, name: str) -> None:
    """The runtime's own tests take minutes to build and run, so that `make test` leaves them out."""
    compiler = compiling.system_compiler()
    if not compiler:
        pytest.skip("needs a C++ compiler")
    folders = [f"-I{ROOT / 'runtime' / folder}" for folder in ("include", "src")]
    source = ROOT / "runtime" / "tests" / f"test_{name}.cpp"
    done = subprocess.run(
        [*compiler, "-std=c++20", "-fsyntax-only", "-w", *folders, source],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_what_has_not_changed_is_not_compiled_again(compiling, monkeypatch, tmp_path) -> None:
    shutil.copytree(ROOT / "runtime" / "include", tmp_path / "include")
    (tmp_path / "src").mkdir()
    for name in ("processor.cpp", "entropy.cpp"):
        shutil.copy(ROOT / "runtime" / "src" / name, tmp_path / "src" / name)
    monkeypatch.setattr(compiling, "HERE", tmp_path)
    monkeypatch.setattr(compiling, "OBJECTS", tmp_path / "objects")
    run, sources = compiling._run, []

    def watched(command: list[str | Path]) -> None:
        sources.extend(word.name for word in command if isinstance(word, Path) and word.suffix == ".cpp")
        run(command)

    monkeypatch.setattr(compiling, "_run", watched)
    if compiling.system_compiler() == []:
        pytest.skip("the system has no compiler")
    processors = len(compiling.this_system().processors)

    def compiled() -> list[str]:
        sources.clear()
        compiling.compile_runtime(tmp_path / "made")
        return sorted(sources)

    assert compiled() == sorted(["entropy.cpp", "processor.cpp"] * processors)
    assert compiled() == []
    with (tmp_path / "src" / "processor.cpp").open("a") as source:
        source.write("// Another line.\n")
    assert compiled() == ["processor.cpp"] * processors
    assert len(list((tmp_path / "made").iterdir())) == processors
    (tmp_path / "src" / "entropy.cpp").write_text("no code")
    with pytest.raises(SystemExit, match="the runtime cannot be compiled"):
        compiled()


@pytest.mark.skipif(not shutil.which("readelf"), reason="readelf is not installed")
def test_the_libraries_need_nothing_but_those_of_c() -> None:
    for path in FOLDER.glob("libuvcloth*.so"):
        said = subprocess.run(["readelf", "-d", path], check=True, capture_output=True, text=True).stdout
        needed = [line.partition("[")[2].rstrip("]") for line in said.splitlines() if "(NEEDED)" in line]
        assert all(name.startswith(("libc.", "libm.")) for name in needed)


def test_uvcloth_core_has_the_player_alone(compiling, tmp_path) -> None:
    pytest.importorskip("setuptools", minversion="80")
    wheels = import_module("wheels")
    wheels.copy_core(ROOT, tmp_path / "core")
    # Objects that are of the same sources by their names are not compiled again.
    shutil.copytree(compiling.OBJECTS, tmp_path / "core" / compiling.OBJECTS.relative_to(ROOT))
    wheel = wheels.build_wheel(tmp_path / "core", Path(wheels.CORE), "", tmp_path)
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
        tops = {name.partition("/")[0] for name in archive.namelist()}
        assert f"uvcloth_core/{BASELINE}" in archive.namelist()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert tops == {"uvcloth_core", f"uvcloth_core-{project['version']}.dist-info"}
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "installed")}
    subprocess.run([sys.executable, "-P", "-c", PLAYED], cwd=tmp_path, env=environment, check=True)
