"""The runtime on other systems, tried on this one: Windows under Wine, and WebAssembly in node.

    python runtime/tests/try_elsewhere.py windows wasm

compiles both by ziglang, plays 30 frames of a baked skirt there and here, and prints how far the vertices are
apart. Compilers round in other ways, and cloth that touches itself makes millimetres of the last digit.
"""

import argparse
import gzip
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "runtime"))

from compile import TARGETS, ZIG, compile_runtime, compile_wasm  # noqa: E402

from uvcloth.bodies.body import load_body  # noqa: E402
from uvcloth.garments.garment import Outfit as WornOutfit  # noqa: E402
from uvcloth.garments.templates import fit_template  # noqa: E402
from uvcloth.methods.physics.outfit import PhysicsConfig, bake_outfit  # noqa: E402
from uvcloth.motion.library import load_clip  # noqa: E402
from uvcloth.player.outfit import Cloth, Outfit  # noqa: E402

FOLDER, FRAMES, FPS = ROOT / "build" / "elsewhere", 30, 30.0

FIRST, MEAN = 1e-3, 20e-3
"""Metres that a vertex may be off in the first frame, and that all are off on average in the last one."""


def windows(outfit: Path, motion: Path, vertices: Path) -> str:
    """Play by the program of docs/runtime.md under Wine."""
    wine = shutil.which("wine") or shutil.which("wine64") or "/usr/lib/wine/wine64"
    if not Path(wine).exists():
        raise SystemExit("Wine is not installed: apt-get install wine")
    compile_runtime(FOLDER, "win_amd64")
    page = (ROOT / "docs" / "runtime.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"^```c\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    (FOLDER / "play.c").write_text(program, encoding="utf-8")
    target = TARGETS["win_amd64"].zig
    library = FOLDER / "libuvcloth.dll"
    command = [*ZIG, "-target", target, f"-I{ROOT / 'runtime' / 'include'}", "-s"]
    subprocess.run([*command, FOLDER / "play.c", library, "-o", FOLDER / "play.exe"], check=True)
    environment = os.environ | {"WINEPREFIX": str(FOLDER / "wine"), "WINEDEBUG": "-all", "DISPLAY": ""}
    names = [path.name for path in (outfit, motion, vertices)]
    subprocess.run([wine, "play.exe", *names], check=True, cwd=FOLDER, env=environment)
    return f"{library.name} of {library.stat().st_size / 1e3:.0f} kB"


def wasm(outfit: Path, motion: Path, vertices: Path) -> str:
    """Play in node."""
    module = FOLDER / "uvcloth.wasm"
    compile_wasm(module)
    command = [
        "node",
        "--no-warnings",
        Path(__file__).with_name("play.mjs"),
        module,
        outfit,
        motion,
        vertices,
    ]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    content = module.read_bytes()
    sizes = f"{len(content) / 1e3:.0f} kB, {len(gzip.compress(content)) / 1e3:.0f} kB compressed"
    return f"{module.name} of {sizes}; {done.stdout.strip()}"


SYSTEMS: dict[str, Callable[[Path, Path, Path], str]] = {"windows": windows, "wasm": wasm}


def write_scene(outfit: Path, motion: Path) -> NDArray[np.float64]:
    """Write a baked skirt and its motion, and return the vertices (F, N, 3) m that this machine gives."""
    body = load_body()
    content = bake_outfit(WornOutfit(body, (fit_template("skirt", body),)), PhysicsConfig())
    transforms = load_clip("walk", body).transforms(torch.float64).numpy()[:FRAMES]
    outfit.write_bytes(content)
    transforms.tofile(motion)
    cloth, frames = Cloth(Outfit(content)), []
    cloth.start(transforms[0])
    begun = time.perf_counter()
    for joints in transforms:
        cloth.step(joints, 1.0 / FPS)
        frames.append(cloth.vertices(0))
    print(f"{1e3 * (time.perf_counter() - begun) / FRAMES:.1f} ms a frame here")
    return np.stack(frames)


def main(names: list[str]) -> None:
    """Try some systems. Raises SystemExit for one on which the cloth is another one."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    outfit, motion = FOLDER / "hero.cloth", FOLDER / "hero.motion"
    expected = write_scene(outfit, motion)
    for name in names:
        path = FOLDER / f"{name}.vertices"
        said = SYSTEMS[name](outfit, motion, path)
        apart = np.linalg.norm(np.fromfile(path).reshape(expected.shape) - expected, axis=2)
        frames = ", ".join(
            f"{1e3 * apart[frame].max():.3f} (mean {1e3 * apart[frame].mean():.3f})" for frame in (0, 9, -1)
        )
        print(f"{name}: {said}\n    mm off in frames 1, 10 and {FRAMES}: {frames}")
        if not (apart[0].max() < FIRST and apart[-1].mean() < MEAN):
            raise SystemExit(f"{name} has other cloth")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("systems", nargs="+", choices=SYSTEMS)
    main(parser.parse_args().systems)
