"""Cost of cloth in a browser: a frame of a page's worker beside the native player's, and the memory of a tab.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/page.py [GLB ...] [--frames 60] [--rounds 7] [--worn 0]
    python benchmarks/page.py [GLB] --minutes 10

with Chromium, on Linux, and the module of `make wasm`. GLB: what `uvcloth bake` wrote, with an animation;
without one, a dress in both qualities and three layers are baked, which walk. Both play the same frames, in
turns, round after round; nothing is drawn meanwhile. --worn: places of the garments that are left of each
file, the innermost first, where others are taken off. For each file it prints the median and the least of the
rounds' mean milliseconds of a frame, vertices included: of processor time of the native player's and of the
worker's thread, which other programs on the machine change less, and by the clock; and how far the worker's
vertices are from the native ones. With --minutes the page plays, draws in software, and prints each minute
the memory, after a collection, of its page and worker, and what all processes of the browser hold. The
machine's load is printed.
"""

import base64
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from http.server import SimpleHTTPRequestHandler
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from tests.commands.chromium import PROGRAM, Chromium
from tests.commands.served import served
from uvcloth.commands.bake import Bake
from uvcloth.commands.options import Quality
from uvcloth.commands.page import Page
from uvcloth.commands.run.bake import bake
from uvcloth.commands.run.page import write_page
from uvcloth.errors import InputError
from uvcloth.player.baked import open_baked
from uvcloth.player.outfit import Cloth, Outfit
from uvcloth.player.worn import without_others
from uvcloth.process.command import run_command

BAKED: tuple[tuple[str, tuple[str, ...], Quality], ...] = (
    ("dress_fast.glb", ("dress",), "fast"),
    ("dress.glb", ("dress",), "default"),
    ("layers.glb", ("bottoms", "tops", "jacket"), "default"),
)
"""Files that are baked where none is given, their garments and quality."""

FPS = 30.0

APART = (0.05, 1.0)
"""Mean distances, mm, from the native vertices; the first frames beyond them are printed."""

OPEN = """(async () => {
  const { openBaked } = await import("./opening.js"), { bytesOf, makeWorker } = await import("./files.js");
  const { cloth } = await openBaked(await bytesOf("%s"), makeWorker(), await bytesOf("uvcloth.wasm"));
  globalThis.cloth = cloth;
})()"""
"""Open a file of the page in a worker, without the page."""

TAKE_OFF = """(async () => {
  const { bytesOf, makeWorker } = await import("./files.js"), whole = cloth;
  const bytes = Uint8Array.from(atob("%s"), (letter) => letter.charCodeAt(0));
  const wasm = await bytesOf("uvcloth.wasm");
  globalThis.cloth = await whole.withOutfit(makeWorker(), wasm, bytes, whole.garments, %s);
  whole.worker.terminate();
})()"""
"""Go on with an outfit, as bytes, of fewer garments."""

BEGIN = """(async () => {
  const bytes = Uint8Array.from(atob("%s"), (letter) => letter.charCodeAt(0));
  globalThis.joints = new Float64Array(bytes.buffer);
  await cloth.start(joints.slice(0, 12 * cloth.bones.length));
})()"""
"""Let the cloth come to rest in the first of transforms, as bytes."""

PLAY = """(async () => {
  const row = 12 * cloth.bones.length, frames = [], begun = performance.now();
  for (let k = 0; k < joints.length; k += row)
    frames.push((await cloth.step(joints.slice(k, k + row), 1 / %g)).vertices);
  const seconds = (performance.now() - begun) / 1e3;
  const rounded = (each) => Array.from(each, (number) => Math.round(number * 1e6));
  globalThis.shown = frames.flat().filter(Boolean).flatMap(rounded);
  return seconds;
})()"""
"""Play them; the seconds that it takes. Vertices stay behind, in micrometres."""

MEMORY = "performance.measureUserAgentSpecificMemory().then(({ bytes }) => bytes)"


@dataclass(frozen=True)
class Pages:
    """Measure cloth in Chromium."""

    file: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Baked files with an animation."""
    frames: int = 60
    """Frames of a round."""
    rounds: int = 7
    """Rounds of each file."""
    worn: tuple[int, ...] = ()
    """Places of the garments that are left, the innermost first; all where none is named."""
    minutes: int = 0
    """Minutes in which memory is watched instead."""

    def run(self) -> None:
        """Print the figures. Raises InputError without Chromium, and as `open_baked` does."""
        if PROGRAM is None:
            raise InputError("Chromium is not installed")
        with tempfile.TemporaryDirectory(prefix="uvcloth-page-") as name:
            folder = Path(name)
            files = self.file or tuple(_bake(folder))
            write_page(Page(folder / "page", files))
            with served(folder / "page", _Isolated) as address, Chromium(folder) as browser:
                if self.minutes:
                    self._watch(browser, address)
                    return
                # A text has the page's modules beside it, and draws nothing.
                browser.open(f"{address}page.css")
                browser.wait_for("document.readyState === 'complete' && location.protocol === 'http:'")
                for file in files:
                    self._measure(browser, file)

    def _measure(self, browser: Chromium, path: Path) -> None:
        baked = open_baked(path)
        joints = baked.motion(fps=FPS).transforms[: self.frames]
        browser.value(OPEN % path.name)
        content = baked.content
        if self.worn:
            content = without_others(content, self.worn)
            browser.value(TAKE_OFF % (base64.b64encode(content).decode(), list(self.worn)))
        costs, loads = [], []
        for _ in range(self.rounds):
            loads.append(os.getloadavg()[0])
            cloth = Cloth(Outfit(content))
            cloth.start(joints[0])
            begun = time.thread_time(), time.perf_counter()
            frames = [_step(cloth, each) for each in joints]
            native = time.thread_time() - begun[0], time.perf_counter() - begun[1]
            sent = base64.b64encode(np.ascontiguousarray(joints).tobytes()).decode()
            browser.value(BEGIN % sent)
            before = _processor_time(browser)
            clock = browser.value(PLAY % FPS)
            costs.append((*native, _processor_time(browser) - before, clock))
        shown = np.array(browser.value("shown")).reshape(len(joints), -1, 3) / 1e6
        browser.value("cloth.worker.terminate()")
        every = 1e3 / len(joints) * np.array(costs).reshape(-1, 2, 2)
        for kind, milliseconds in zip(("processor", "clock"), np.moveaxis(every, 2, 0), strict=True):
            (native, worker), least = np.median(milliseconds, 0), milliseconds.min(0)
            print(
                f"{path.name}, ms of {kind}: native {native:.1f} ({least[0]:.1f}), worker {worker:.1f} "
                f"({least[1]:.1f}), ratio {worker / native:.2f} ({least[1] / least[0]:.2f})"
            )
        expected = np.stack([np.concatenate([baked.in_scene(each) for each in frame]) for frame in frames])
        off = 1e3 * np.linalg.norm(shown - expected, axis=2).mean(1)
        beyond = ", ".join(
            f"beyond {limit} mm from frame {np.argmax(off > limit)}" for limit in APART if (off > limit).any()
        )
        print(
            f"  load {min(loads):.1f} to {max(loads):.1f}; {off[:10].mean():.4f} mm apart in ten frames, "
            f"{off.mean():.2f} in all; {beyond}",
            flush=True,
        )

    def _watch(self, browser: Chromium, address: str) -> None:
        browser.open(address)
        browser.wait_for("Boolean(globalThis.uvcloth?.playback.shown > 0.1)")
        begun = time.monotonic()
        for minute in range(self.minutes + 1):
            time.sleep(max(0.0, begun + 60.0 * minute - time.monotonic()))
            frames, tab = browser.value("uvcloth.playback.next"), browser.value(MEMORY) / 1e6
            held, load = _held(browser) / 1e6, os.getloadavg()[0]
            print(
                f"minute {minute}: {tab:.1f} MB of page and worker, {held:.0f} MB of processes; "
                f"frame {frames} of cloth, load {load:.1f}, errors {browser.errors}",
                flush=True,
            )


def _bake(folder: Path) -> Iterator[Path]:
    for name, garments, quality in BAKED:
        bake(Bake(garments, folder / name, motion="walk", quality=quality))
        yield folder / name


def _step(cloth: Cloth, joints: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Vertices of each garment after a frame of the native player."""
    cloth.step(joints, 1.0 / FPS)
    return [cloth.vertices(garment) for garment in range(len(cloth.outfit.garments))]


def _processes(browser: Chromium) -> Iterator[Path]:
    """Folders in /proc of a browser and all its children."""
    pending = [browser.pid]
    for pid in pending:
        folder = Path("/proc", str(pid))
        yield folder
        pending += [
            int(child) for each in folder.glob("task/*/children") for child in each.read_text().split()
        ]


def _processor_time(browser: Chromium) -> float:
    """Seconds that the browser's worker has run."""
    threads = (thread for process in _processes(browser) for thread in process.glob("task/*"))
    (worker,) = (each for each in threads if (each / "comm").read_text().startswith("DedicatedWorker"))
    return int((worker / "schedstat").read_text().split()[0]) / 1e9


def _held(browser: Chromium) -> float:
    """Memory, bytes, of a browser, its processes' common pages once."""
    rows = [(process / "smaps_rollup").read_text().splitlines() for process in _processes(browser)]
    return sum(1024.0 * int(row.split()[1]) for each in rows for row in each if row.startswith("Pss:"))


class _Isolated(SimpleHTTPRequestHandler):
    """A server of files whose pages may measure their memory."""

    def end_headers(self) -> None:
        self.send_header("Cross-Origin-Opener-Policy", "same-origin")
        self.send_header("Cross-Origin-Embedder-Policy", "require-corp")
        super().end_headers()

    def log_message(self, format: str, *arguments: Any) -> None:
        """Say nothing of what is asked for."""


if __name__ == "__main__":
    sys.exit(run_command("page.py", lambda: tyro.cli(Pages).run()))
