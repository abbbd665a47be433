"""The zips of the extension, by platform, and the index that makes their folder a repository."""

import hashlib
import json
import subprocess
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

from tests.blender.conftest import load_module

FILE = Path(__file__).parents[2] / "blender" / "build.py"
TAGS = {
    "linux-x64": "manylinux_2_17_x86_64.manylinux2014_x86_64",
    "macos-arm64": "macosx_11_0_arm64",
    "windows-x64": "win_amd64",
}
"""Tags of wheels by Blender's platform."""

CLIENT = (
    "import addon_utils, os; print(os.path.join(addon_utils.paths()[0], 'bl_pkg', 'cli', 'blender_ext.py'))"
)


@pytest.fixture(scope="module")
def build() -> ModuleType:
    """The program as a module."""
    return load_module("extension_build", FILE)


@pytest.fixture
def repository(build: ModuleType, tmp_path: Path) -> Path:
    """A folder with an extension for each platform, around wheels without content, and its index."""
    version = tomllib.loads((build.EXTENSION / build.MANIFEST).read_text(encoding="utf-8"))["version"]
    folder = tmp_path / "repository"
    folder.mkdir()
    for tag in TAGS.values():
        wheel = tmp_path / f"uvcloth_core-{version}-py3-none-{tag}.whl"
        with zipfile.ZipFile(wheel, "w") as archive:
            archive.writestr("uvcloth_core/__init__.py", "")
        build.build_extension(folder, wheel)
    build.write_index(folder)
    return folder


def test_the_index_names_every_zip_by_what_is_in_it(build: ModuleType, repository: Path) -> None:
    index = json.loads((repository / build.INDEX).read_text(encoding="utf-8"))
    assert (index["version"], index["blocklist"]) == ("v1", [])
    assert {tuple(entry["platforms"]) for entry in index["data"]} == {(name,) for name in TAGS}
    for entry in index["data"]:
        path = repository / entry["archive_url"]
        content = path.read_bytes()
        assert entry["archive_hash"] == f"sha256:{hashlib.sha256(content).hexdigest()}"
        assert entry["archive_size"] == len(content)
        with zipfile.ZipFile(path) as archive:
            manifest = tomllib.loads(archive.read(build.MANIFEST).decode())
            (wheel,) = (name for name in archive.namelist() if name.startswith("wheels/"))
        assert manifest["wheels"] == [f"./{wheel}"]
        assert manifest["platforms"] == entry["platforms"]
        assert "wheels" not in entry


def test_it_asks_for_no_network(repository: Path) -> None:
    """Nothing is downloaded by the extension itself, as the platform's terms ask."""
    for path in repository.glob("*.zip"):
        with zipfile.ZipFile(path) as archive:
            manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
        assert set(manifest["permissions"]) == {"files", "clipboard"}


def test_blender_reads_the_index_and_installs_from_it(
    build: ModuleType, repository: Path, blender_python: str, tmp_path: Path
) -> None:
    """By the client that Blender itself runs, with the folder as the address."""
    printed = subprocess.run(
        [blender_python, "-c", f"import bpy; {CLIENT}"], check=True, capture_output=True, text=True
    )
    client = printed.stdout.strip().splitlines()[-1]
    local = tmp_path / "local"

    def run(*words: str) -> str:
        command = [blender_python, client, *words]
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    where = ("--local-dir", str(local), "--remote-url", (repository / build.INDEX).as_uri())
    for path in repository.glob("*.zip"):
        run("validate", str(path))
    run("sync", *where)
    assert "uvcloth" in run("list", *where)
    run("install", *where, "--blender-version", "4.5.0", "uvcloth")
    assert (local / "uvcloth" / build.MANIFEST).is_file()


def test_a_zip_of_something_else_is_no_extension(build: ModuleType, repository: Path) -> None:
    with zipfile.ZipFile(repository / "other.zip", "w") as archive:
        archive.writestr("readme.txt", "")
    with pytest.raises(ValueError, match=r"other\.zip: has no blender_manifest\.toml"):
        build.write_index(repository)
