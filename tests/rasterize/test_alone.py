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

ONLY_RASTERIZE = """
import sys
others = {name.partition(".")[0] for name in sys.modules} & {"uvcloth", "train", "evaluate"}
assert not others, others
"""


def test_the_program_of_the_page_runs_without_the_rest_of_the_project(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "maps.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    shutil.copytree(ROOT / "rasterize", tmp_path / "rasterize")
    (tmp_path / "maps.py").write_text(program + ONLY_RASTERIZE, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "maps.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    numbers = re.fullmatch(r"(\d+) texels, 100% see the shell, which is found to (\S+) mm\n", done.stdout)
    assert numbers, done.stdout
    assert int(numbers[1]) > 0.4 * 256**2
    assert float(numbers[2]) < 0.5
    assert sorted(read_channels(tmp_path / "offset.exr")) == ["offset.X", "offset.Y", "offset.Z"]


def test_warp_starts_where_there_is_no_home(tmp_path: Path) -> None:
    """Its cache of kernels then is a folder of this user's alone."""
    (tmp_path / "file").touch()
    usual = {
        key: value for key, value in os.environ.items() if key not in ("XDG_CACHE_HOME", "WARP_CACHE_PATH")
    }
    homeless = usual | {"HOME": str(tmp_path / "file" / "home"), "TMPDIR": str(tmp_path)}
    code = "import rasterize.closest, warp; print(warp.config.kernel_cache_dir)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=homeless, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    (cache,) = tmp_path.glob("warp-cache*")
    assert done.stdout.strip().startswith(str(cache))
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
