"""docs/maps.md: its program runs where nothing else of this project is."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

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
