"""Build the wheels of uvcloth and of uvcloth-core for every platform, all on this one, by ziglang.

`python runtime/wheels.py dist` (`make wheels`) writes them into dist/. uvcloth-core has the runtime alone, as
the package `uvcloth_core`: with the name of its own it does not get in the way of an installed uvcloth.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from compile import TARGETS, compile_wasm

ROOT = Path(__file__).resolve().parents[1]
PLAYER, CORE = Path("uvcloth/player"), "uvcloth_core"


def copy_sources(folder: Path) -> None:
    """Copy what git tracks, or will, into a folder: building leaves files beside the sources."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in listed.split("\0"):
        if name and (ROOT / name).is_file() and not name.startswith(("benchmarks/", "tests/", "docs/")):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)


def copy_core(source: Path, folder: Path) -> None:
    """Make the sources of uvcloth-core from those of uvcloth: the player, by its other name."""
    shutil.copytree(source / "runtime" / "core", folder)
    shutil.copytree(source / "runtime", folder / "runtime", ignore=shutil.ignore_patterns("core", "tests"))
    for name in ("LICENSE", "NOTICE"):
        shutil.copy(source / name, folder / name)
    (folder / CORE).mkdir()
    (folder / CORE / "py.typed").touch()
    name = ".".join(PLAYER.parts)
    for module in (source / PLAYER).glob("*.py"):
        text = module.read_text(encoding="utf-8")
        (folder / CORE / module.name).write_text(text.replace(name, CORE), encoding="utf-8")


def build_wheel(source: Path, player: Path, platform: str, target: Path) -> Path:
    """Build the wheel of a folder of sources for a platform of TARGETS; returns its path."""
    for library in (source / player).glob("libuvcloth*"):
        library.unlink()
    # What an earlier wheel left, except the objects.
    for left in ("lib*", "bdist*"):
        for folder in (source / "build").glob(left):
            shutil.rmtree(folder)
    code = "import sys; from setuptools import build_meta; print(build_meta.build_wheel(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", code, target.resolve()], cwd=source, check=False, text=True,
        env=os.environ | {"UVCLOTH_PLATFORM": platform}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    if done.returncode:
        raise SystemExit(f"{done.stdout}\nthe wheel for {platform} cannot be built")
    return target / done.stdout.splitlines()[-1]


def build_wheels(target: Path, platforms: Iterable[str] = TARGETS) -> list[Path]:
    """Build both distributions for some platforms; returns the paths of the wheels."""
    target.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="uvcloth-wheels-") as place:
        source, core = Path(place) / "source", Path(place) / "core"
        copy_sources(source)
        copy_core(source, core)
        # The pages of `uvcloth page` have the runtime for browsers, the same on every platform.
        compile_wasm(source / PLAYER / "uvcloth.wasm")
        return [
            build_wheel(folder, player, platform, target)
            for folder, player in ((source, PLAYER), (core, Path(CORE)))
            for platform in platforms
        ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("target", type=Path)
    parser.add_argument("--platforms", nargs="+", choices=TARGETS, default=list(TARGETS), metavar="PLATFORM")
    arguments = parser.parse_args()
    for wheel in build_wheels(arguments.target, arguments.platforms):
        print(f"{wheel}  {wheel.stat().st_size / 1e6:.2f} MB")
