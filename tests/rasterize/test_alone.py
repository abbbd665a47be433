"""docs/maps.md: its program runs where nothing else of this project is."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rasterize.cache_folder import temporary_cache
from tests.rasterize.exr_channels import read_channels

ROOT = Path(__file__).parents[2]

AND_MORE = """
import sys
import rasterize.closest, warp
others = {name.partition(".")[0] for name in sys.modules} & {"uvcloth", "train", "evaluate"}
assert not others, others
print(warp.config.kernel_cache_dir)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `rasterize` alone, for programs without a home."""
    folder = tmp_path_factory.mktemp("alone")
    shutil.copytree(ROOT / "rasterize", folder / "rasterize")
    (folder / "file").touch()
    return folder


@pytest.fixture(scope="module")
def lines(folder: Path) -> list[str]:
    """What the program of the page prints in that folder, and the folder of Warp's kernels."""
    page = (ROOT / "docs" / "maps.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    (folder / "maps.py").write_text(program + AND_MORE, encoding="utf-8")
    others = ("XDG_CACHE_HOME", "WARP_CACHE_PATH", "PYTHONPATH")
    usual = {key: value for key, value in os.environ.items() if key not in others}
    homeless = usual | {"HOME": str(folder / "file" / "home"), "TMPDIR": str(folder)}
    command = [sys.executable, "maps.py"]
    done = subprocess.run(command, cwd=folder, env=homeless, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.thorough
def test_the_program_of_the_page_runs_without_the_rest_of_the_project(folder: Path, lines: list[str]) -> None:
    numbers = re.fullmatch(r"(\d+) texels, 100% see the shell, which is found to (\S+) mm", lines[0])
    assert numbers, lines
    assert int(numbers[1]) > 0.4 * 256**2
    assert float(numbers[2]) < 0.5
    assert sorted(read_channels(folder / "offset.exr")) == ["offset.X", "offset.Y", "offset.Z"]


@pytest.mark.thorough
def test_warp_starts_where_there_is_no_home(folder: Path, lines: list[str]) -> None:
    """Its cache of kernels then is a folder of this user's alone."""
    (cache,) = folder.glob("warp-cache*")
    assert lines[-1].startswith(str(cache))
    assert cache.stat().st_mode & 0o077 == 0


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="files have no owners")
def test_a_cache_that_others_can_write_to_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is in it would be run."""
    monkeypatch.setattr("rasterize.cache_folder.gettempdir", lambda: str(tmp_path))
    temporary_cache("own").chmod(0o777)
    with pytest.raises(PermissionError, match="others can write to it"):
        temporary_cache("own")
    temporary_cache("other").rename(tmp_path / "moved")
    (tmp_path / f"other-{os.getuid()}").symlink_to(tmp_path / "moved")
    with pytest.raises(PermissionError, match="others can write to it"):
        temporary_cache("other")
