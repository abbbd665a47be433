"""Compiled loops: the first run after an installation gives the bytes of all later ones, wherever it runs."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from filelock import FileLock, Timeout

from uvcloth.process.compiled import CACHE_VARIABLE
from uvcloth.process.compiling import LOCK

ROOT = Path(__file__).parents[2]

LIMIT = 900
"""Seconds that a test waits at most; a machine may be busy."""

DISTANCES = """
import numpy as np
from uvcloth.bodies.opened_kernels import Plan, distances

# Two rough walls of 24 x 24 vertices, 2 cm apart, which face each other.
size = 24
x, y = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
wall = 0.01 * np.stack([x, y, 0 * x], -1).reshape(-1, 3)
corners = np.concatenate([wall, wall + [0, 0, 0.02]])
corners = (corners + 0.002 * np.random.default_rng(0).random(corners.shape)).astype(np.float32)
first = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
lower = np.concatenate([
    np.stack([first, first + size, first + size + 1], 1), np.stack([first, first + size + 1, first + 1], 1)
])
faces = np.concatenate([lower, lower[:, ::-1] + size * size])
turned = np.concatenate([np.roll(faces, -turn, 1)[:, 1:] for turn in range(3)])
order = np.argsort(faces.T.ravel(), kind="stable")
count = len(corners)
indices, metres = np.zeros(0, np.int32), np.zeros(0, np.float32)
plan = Plan(
    starts=np.array([0, size * size, count], np.int32),
    points=np.arange(count, dtype=np.int32),
    want=np.zeros(count, np.float32),
    core=np.full(count, 1e-4, np.float32),
    slope=0.75,
    allowed=np.zeros((2, count), np.float32),
    ring_starts=np.concatenate([[0], np.cumsum(np.bincount(faces.ravel()))]).astype(np.int32),
    rings=turned[order].astype(np.int32),
    spread_starts=np.zeros(count + 1, np.int32),
    spread_vertices=indices,
    spread_lengths=metres,
    tips=indices,
    rim_starts=np.zeros(1, np.int32),
    rims=indices,
)
print(distances(corners, plan).tobytes().hex())
"""

LOOPS = """
from uvcloth.process.compiled import compiled

@compiled
def double(values):
    for row in range(len(values)):
        values[row] *= 2.0

@compiled
def quadruple(values):
    double(values)
    double(values)
"""

QUADRUPLE = """
import numpy as np
from loops import quadruple

values = np.arange(5.0)
quadruple(values)
print(values.tolist())
"""


def start(code: str, cache: Path, **environment: str) -> subprocess.Popen:
    """A process that runs some code with modules beside the cache."""
    paths = os.pathsep.join([str(ROOT), str(cache.parent)])
    env = {**os.environ, CACHE_VARIABLE: str(cache), "PYTHONPATH": paths, **environment}
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", code], stdout=pipe, stderr=pipe, text=True, env=env)


def output(process: subprocess.Popen) -> str:
    """The output of a process that ends without a word of trouble."""
    try:
        said, errors = process.communicate(timeout=LIMIT)
    finally:
        process.kill()
    assert (process.returncode, errors) == (0, "")
    return said


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    """An empty cache beside a module of two loops."""
    (tmp_path / "loops.py").write_text(LOOPS)
    return tmp_path / "cache"


def test_the_first_run_gives_the_bytes_of_later_ones(cache: Path) -> None:
    first, later = (output(start(DISTANCES, cache)) for _ in range(2))
    assert len(first) > 9000
    assert first == later


def test_processes_that_start_together_compile_once(cache: Path) -> None:
    together = [start(QUADRUPLE, cache) for _ in range(3)]
    assert [output(process) for process in together] == ["[0.0, 4.0, 8.0, 12.0, 16.0]\n"] * 3
    files = list(cache.rglob("*.nbc"))
    assert sorted(path.name.partition("-")[0] for path in files) == ["loops.double", "loops.quadruple"]
    kept, times = list(cache.rglob("*.nb?")), [path.stat().st_mtime_ns for path in files]
    # Nor does one that has the same sources elsewhere, as those of another installation are.
    elsewhere = cache.parent / "elsewhere" / cache.parent.name
    elsewhere.mkdir(parents=True)
    (cache.parent / "loops.py").rename(elsewhere / "loops.py")
    paths = os.pathsep.join([str(ROOT), str(elsewhere)])
    assert output(start(QUADRUPLE, cache, PYTHONPATH=paths)) == "[0.0, 4.0, 8.0, 12.0, 16.0]\n"
    assert list(cache.rglob("*.nb?")) == kept
    assert [path.stat().st_mtime_ns for path in files] == times


def test_without_a_folder_that_can_be_written_it_compiles_for_itself(cache: Path) -> None:
    cache.write_text("a file where a folder should be")
    code = f"import tempfile; tempfile.tempdir = {str(cache)!r}\n" + QUADRUPLE
    said = output(start(code, cache, XDG_CACHE_HOME=str(cache)))
    assert said == "[0.0, 4.0, 8.0, 12.0, 16.0]\n"


def test_where_files_cannot_be_saved_it_compiles_for_itself(cache: Path) -> None:
    """A full disk, as far as Numba's files go."""
    broken = "import numba.core.caching as c\ndef full(*_): raise OSError(28, 'full')\n"
    (cache.parent / "sitecustomize.py").write_text(broken + "c.IndexDataCacheFile.save = full\n")
    assert output(start(QUADRUPLE, cache)) == "[0.0, 4.0, 8.0, 12.0, 16.0]\n"
    assert list(cache.rglob("*.nb?")) == []


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is sent otherwise there")
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGKILL])
def test_a_process_that_is_interrupted_takes_its_compiler_along(sent: signal.Signals, cache: Path) -> None:
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n" + DISTANCES
    with start(code, cache) as process:
        try:
            deadline = time.monotonic() + LIMIT
            while not (locks := list(cache.rglob(LOCK))):
                assert time.monotonic() < deadline
                assert process.poll() is None
                time.sleep(0.05)
            process.send_signal(sent)
            _, errors = process.communicate(timeout=LIMIT)
        finally:
            process.kill()
    assert ("KeyboardInterrupt" in errors) == (sent == signal.SIGINT)
    # The compiler holds the lock for as long as it runs, which is much longer.
    try:
        with FileLock(locks[0], timeout=5):
            pass
    except Timeout:
        pytest.fail("the compiler goes on")
    assert not list(cache.rglob("*distances*.nbc"))
