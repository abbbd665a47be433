"""The compiled runtime: it is there, needs NumPy alone, and its absence has a sentence."""

import subprocess
import sys
from pathlib import Path

import pytest

from uvcloth.player import library as loading
from uvcloth.player.library import BASELINE, WIDE, library

ROOT = Path(__file__).parents[2]

# The libraries end as modules in C do, but are none.
ALONE = """
import importlib, pkgutil, sys
import numpy
before = set(sys.modules)
import uvcloth.player.library
for module in pkgutil.iter_modules(uvcloth.player.__path__):
    if not module.name.startswith("libuvcloth"):
        importlib.import_module(f"uvcloth.player.{module.name}")
uvcloth.player.library.library()
tops = {name.partition(".")[0] for name in set(sys.modules) - before}
print(sorted(tops - {"uvcloth", "numpy"} - set(sys.stdlib_module_names)))
print(sorted(name for name in sys.modules if name.startswith("uvcloth.") and "player" not in name))
"""


def test_the_player_needs_nothing_but_numpy() -> None:
    command = [sys.executable, "-P", "-c", ALONE]
    done = subprocess.run(command, cwd=ROOT, env={"PYTHONPATH": str(ROOT)}, check=True, capture_output=True)
    assert done.stdout.decode().split("\n")[:2] == ["[]", "[]"]


def test_the_library_that_suits_the_processor_is_loaded() -> None:
    assert (loading.FOLDER / BASELINE).exists()
    wide = bool(loading._load(loading.FOLDER / BASELINE).uvc_has_v3()) and (loading.FOLDER / WIDE).exists()
    assert Path(library()._name).name == (WIDE if wide else BASELINE)
    cpu = Path("/proc/cpuinfo")
    if (loading.FOLDER / WIDE).exists() and cpu.exists():
        assert wide == ({"avx2", "fma", "bmi2"} <= set(cpu.read_text().split()))


def test_a_library_that_is_missing_or_damaged_has_a_sentence(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(loading, "FOLDER", tmp_path)
    with pytest.raises(ImportError, match=rf"{BASELINE} is missing: .*make install"):
        library.__wrapped__()
    (tmp_path / BASELINE).write_bytes(b"no library")
    with pytest.raises(ImportError, match=rf"{BASELINE} cannot be loaded, .*make install"):
        library.__wrapped__()
