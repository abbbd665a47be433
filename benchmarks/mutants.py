"""Mutation testing of the rooms that decide what a user gets: which small faults do their tests not notice?

python benchmarks/mutants.py --out ../mutants --room export --count 30

Plants one fault at a time into a copy of the checkout: another operator, a lost sign, another index or axis,
a changed number, a turned condition, a dropped statement. --seed draws the places. Results are lines of
OUT/results.jsonl; a run with the same OUT goes on where the last one ended. A mutant is tested by the tests
of its room alone, up to the first that fails, in a fork of this process, in which the libraries are loaded
once. Tests that run its line come first. The compiled runtime is not mutated.

mutmut's trampolines cannot be compiled by Warp. cosmic-ray neither samples nor drops statements, and starts
Python anew for every mutant, which is most of the time here. So this is our own.
"""

import ast
import importlib
import json
import os
import resource
import shutil
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import suppress
from copy import deepcopy
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random
from typing import Any

import pytest
import tyro
from coverage import Coverage
from rich.console import Console
from rich.table import Table

from uvcloth.player.library import FOLDER

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Room:
    """Files that are mutated, and the tests that should notice: patterns of paths."""

    sources: tuple[str, ...]
    tests: tuple[str, ...]


ROOMS = {
    "export": Room(
        (
            *("uvcloth/writers/gltf*.py", "uvcloth/writers/usd*.py", "uvcloth/writers/obj*.py"),
            *(f"uvcloth/writers/{name}.py" for name in ("alembic", "animation", "glb", "pointcache", "rig")),
        ),
        (
            "tests/writers/test_oracle.py",
            *(f"tests/writers/test_{name}*.py" for name in ("gltf", "usd", "alembic", "obj", "pointcache")),
            *(f"tests/writers/test_{name}.py" for name in ("survival", "rig", "writer", "full_disk")),
        ),
    ),
    "rollout": Room(
        ("uvcloth/rollouts/rollout.py", "uvcloth/rollouts/looped.py"),
        ("tests/test_rollout.py", "tests/test_looped.py", "tests/test_places.py"),
    ),
    "physics": Room(("uvcloth/physics/*.py",), ("tests/physics/test_*.py",)),
    "cloth": Room(("uvcloth/physics/cloth/*.py",), ("tests/physics/cloth/test_*.py",)),
    "retarget": Room(
        tuple(f"uvcloth/motion/{name}.py" for name in ("retarget", "rest", "arms", "posture", "clip", "bvh")),
        tuple(f"tests/motion/test_{name}.py" for name in ("retarget", "rest", "arms", "bvh", "families")),
    ),
    "decode": Room(
        tuple(f"rasterize/{name}.py" for name in ("decode", "gather", "bake", "texels", "layout")),
        tuple(f"tests/rasterize/test_{name}.py" for name in ("decode", "gather", "bake", "texels", "layout")),
    ),
    "losses": Room(
        (
            *("train/deepsd/losses.py", "train/deepsd/outfit_energy.py", "train/pbns/energy.py"),
            *(
                "train/physxnet/patchgan.py",
                "train/loop.py",
                "train/mirror.py",
                "uvcloth/physics/energies.py",
            ),
        ),
        (
            *(
                "tests/train/test_loop.py",
                "tests/train/pbns/test_energy.py",
                "tests/physics/test_energies.py",
            ),
            *("tests/train/physxnet", "tests/train/test_mirror.py", "tests/train/deepsd"),
        ),
    ),
}

LIBRARIES = (
    *("torch", "numpy", "scipy.spatial", "scipy.sparse.linalg", "trimesh", "kornia", "pygltflib"),
    *("hypothesis", "pxr.Usd", "pxr.UsdSkel", "alembic3d", "lightning_fabric", "torch.utils.tensorboard"),
)
"""Loaded before the forks."""

SPARE_SECONDS = 10
"""CPU seconds that a mutant may take beyond twice those of the tests without a fault."""

SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Pow: ast.Mult, ast.Mod: ast.Add, ast.Lt: ast.GtE, ast.LtE: ast.Lt, ast.Gt: ast.LtE, ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
"""Operators and what takes their place."""


@dataclass(frozen=True)
class Mutant:
    """A fault: text that takes the place of another. start, end: (line from 1, byte) of it."""

    file: str
    kind: str
    start: tuple[int, int]
    end: tuple[int, int]
    text: str

    def source(self, content: str) -> str:
        """The content of the file with the fault."""
        lines = content.encode().splitlines(keepends=True)
        (first, left), (last, right) = self.start, self.end
        head = b"".join(lines[: first - 1]) + lines[first - 1][:left]
        tail = lines[last - 1][right:] + b"".join(lines[last:])
        return (head + self.text.encode() + tail).decode()


def mutants_of(file: str, content: str) -> Iterator[Mutant]:
    """Every fault that can be planted into a file."""
    for node in _code(ast.parse(content)):
        for kind, changed in _changes(node):
            text = ast.unparse(changed)
            text = text if isinstance(node, ast.stmt) else f"({text})"
            start, end = (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)
            yield Mutant(file, kind, start, end, text)


def _code(node: ast.AST) -> Iterator[Any]:
    """The nodes that compute: no annotations, decorators, error messages or texts."""
    skipped = {"annotation", "returns", "decorator_list", "names"}
    for name, value in ast.iter_fields(node):
        if name in skipped or isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                if hasattr(child, "lineno"):
                    yield child
                yield from _code(child)


def _changes(node: Any) -> Iterator[tuple[str, ast.AST]]:
    """Faults of one node: their kind, and the node that takes its place."""
    new = deepcopy(node)
    match node:
        case ast.BinOp() | ast.BoolOp() if type(node.op) in SWAPS:
            new.op = SWAPS[type(node.op)]()
            yield "operator", new
        case ast.Compare(ops=[operator]) if type(operator) in SWAPS:
            new.ops = [SWAPS[type(operator)]()]
            yield "comparison", new
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            yield "sign", operand
        case ast.Constant(value=bool(value)):
            yield "constant", ast.Constant(not value)
        case ast.Constant(value=int(value)):
            yield "index or number", ast.Constant(value + 1)
        case ast.Constant(value=float(value)):
            yield "number", ast.Constant(value * 1.5 + 0.1 * (value == 0))
        case ast.IfExp(body=body, orelse=other):
            yield "condition", ast.IfExp(node.test, other, body)
        case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Assign(targets=[ast.Subscript()]):
            yield "dropped", ast.Pass()
        case ast.If(orelse=[]):
            new.test = ast.Constant(False)
            yield "dropped", new


def drawn(room: Room, count: int, seed: int) -> list[Mutant]:
    """Faults of a room in random order, so that a larger count begins with those of a smaller one."""
    files = sorted({path for pattern in room.sources for path in ROOT.glob(pattern)})
    found = [
        mutant
        for path in files
        for mutant in mutants_of(path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8"))
    ]
    Random(seed).shuffle(found)
    return found[:count]


class FirstFailure:
    """A pytest plugin that writes the name of the first test that fails to a file."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Keep the name of a failed test."""
        if report.failed and not self._path.exists():
            self._path.write_text(report.nodeid)


@dataclass(frozen=True)
class Trace:
    """What each test of a room took and ran: seconds, and lines of the room's files, by the test's name.

    Lines that fixtures run are under the name of the test's file.
    """

    seconds: dict[str, float]
    lines: dict[str, dict[str, list[int]]]

    def far(self, mutant: Mutant, test: str) -> tuple[bool, bool, float]:
        """Key that sorts tests: those that run the line, then those that run others of its file."""
        file = test.partition("::")[0]
        ran = {*self._lines(test, mutant.file), *self._lines(file, mutant.file)}
        lines = range(mutant.start[0], mutant.end[0] + 1)
        return ran.isdisjoint(lines), not ran, self.seconds.get(test, 0.0)

    def _lines(self, context: str, file: str) -> list[int]:
        return self.lines.get(context, {}).get(file, [])


class Tracing:
    """A pytest plugin that writes a `Trace`."""

    def __init__(self, copy: Path, room: Room, path: Path) -> None:
        self._copy = copy
        self._path = path
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._coverage = Coverage(
            config_file=False, data_file=None, include=[str(copy / source) for source in room.sources]
        )
        self._coverage.start()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        """Fixtures are shared by the tests of a file."""
        self._coverage.switch_context(item.nodeid.partition("::")[0])

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_call(self, item: pytest.Item) -> None:
        """From here on the lines are those of the test."""
        self._coverage.switch_context(item.nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add what a phase of the test took."""
        self._seconds[report.nodeid] += report.duration

    def pytest_sessionfinish(self) -> None:
        """Write what was seen."""
        self._coverage.stop()
        data = self._coverage.get_data()
        lines: dict[str, dict[str, list[int]]] = {}
        for file in data.measured_files():
            name = Path(file).relative_to(self._copy).as_posix()
            for line, contexts in data.contexts_by_lineno(file).items():
                for context in contexts:
                    lines.setdefault(context, {}).setdefault(name, []).append(line)
        self._path.write_text(json.dumps({"seconds": self._seconds, "lines": lines}))


class NearestFirst:
    """A pytest plugin that sorts tests by how near they are to a mutant; those of a file stay together."""

    def __init__(self, mutant: Mutant, trace: Trace) -> None:
        self._mutant = mutant
        self._trace = trace

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Sort them."""
        far = {item.nodeid: self._trace.far(self._mutant, item.nodeid) for item in items}
        nearest: dict[str, tuple[bool, bool, float]] = {}
        for test, key in far.items():
            file = test.partition("::")[0]
            nearest[file] = min(nearest.get(file, key), key)
        items.sort(key=lambda item: (nearest[item.nodeid.partition("::")[0]], far[item.nodeid]))


@dataclass(frozen=True)
class Tried:
    """Outcome of a test run: killed, survived or time; the test that failed; CPU seconds."""

    outcome: str
    by: str
    seconds: float


def try_tests(copy: Path, room: Room, limit: int, plugin: Any) -> Tried:
    """Run the tests of a room in a fork of this process, with a plugin of pytest that is made there."""
    said = copy.parent / "failed"
    said.unlink(missing_ok=True)
    child = os.fork()
    if not child:
        code = 99
        try:
            code = _run_tests(copy, room, limit, [FirstFailure(said), plugin()])
        finally:
            os._exit(code)
    _, status, used = os.wait4(child, 0)
    seconds = round(used.ru_utime + used.ru_stime, 1)
    by = said.read_text() if said.exists() else ""
    if os.WIFSIGNALED(status):
        return Tried("time", by, seconds)
    return Tried("survived" if os.WEXITSTATUS(status) == 0 else "killed", by, seconds)


def _run_tests(copy: Path, room: Room, limit: int, plugins: list[Any]) -> int:
    """The exit code of pytest in the copy of the checkout."""
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
    os.chdir(copy)
    os.environ.update(PYTHONPATH=str(copy), PYTHONDONTWRITEBYTECODE="1")
    sys.path[:] = [str(copy), *(path for path in sys.path if Path(path or ".").resolve() != ROOT)]
    sys.dont_write_bytecode = True
    paths = dict.fromkeys(
        str(path.relative_to(copy)) for test in room.tests for path in sorted(copy.glob(test))
    )
    with (copy.parent / "output").open("w") as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
        return pytest.main(["-x", "-q", "-n0", "-p", "no:cacheprovider", *paths], plugins=plugins)


def make_copy(folder: Path) -> Path:
    """A copy of the files that git tracks, or will."""
    copy = folder / "checkout"
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    names = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split("\0")
    for name in filter(None, names):
        if (ROOT / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, copy / name)
    for library in FOLDER.glob("libuvcloth*"):
        shutil.copy(library, copy / library.relative_to(ROOT))
    return copy


@dataclass(frozen=True)
class Mutants:
    """Plant faults, run the tests of their room, and say which were not noticed."""

    out: Path
    """Folder of the results."""
    room: tuple[str, ...] = tuple(ROOMS)
    """Some of the rooms."""
    count: int = 30
    """Mutants of each room."""
    seed: int = 0
    """Decides the places."""

    def run(self) -> None:
        """Try the mutants that have no result yet, and print the table."""
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        for name in LIBRARIES:
            with suppress(ImportError):
                importlib.import_module(name)
        folder = self.out.resolve()
        shutil.rmtree(folder / "checkout", ignore_errors=True)
        copy = make_copy(folder)
        results = folder / "results.jsonl"
        done = {
            json.dumps(row["mutant"]): row
            for row in map(json.loads, results.read_text().splitlines() if results.exists() else ())
        }
        for name in self.room:
            room = ROOMS[name]
            trace, limit = self._trace(name, room, copy, folder)
            for number, mutant in enumerate(drawn(room, self.count, self.seed)):
                if json.dumps(asdict(mutant)) in done:
                    continue
                tried = self._try(mutant, trace, room, copy, folder, limit)
                row = {"room": name, "seed": self.seed, "mutant": asdict(mutant), **asdict(tried)}
                done[json.dumps(asdict(mutant))] = json.loads(json.dumps(row))
                with results.open("a") as stream:
                    stream.write(json.dumps(row) + "\n")
                place = f"{mutant.file}:{mutant.start[0]}"
                print(f"{name} {number} {tried.outcome} {tried.seconds} s {place} {mutant.kind}", flush=True)
        _print_table(list(done.values()))

    def _trace(self, name: str, room: Room, copy: Path, folder: Path) -> tuple[Trace, int]:
        """What the tests of a room run, and CPU seconds for a mutant; they have to pass without one."""
        path = folder / "trace.json"
        tried = try_tests(copy, room, 3600, lambda: Tracing(copy, room, path))
        print(f"{name}: {tried.seconds} CPU s without a fault", flush=True)
        if tried.outcome != "survived":
            raise SystemExit(f"{name}: the tests fail without a fault: {tried.by}, {folder / 'output'}")
        return Trace(**json.loads(path.read_text())), int(2 * tried.seconds) + SPARE_SECONDS

    def _try(self, mutant: Mutant, trace: Trace, room: Room, copy: Path, folder: Path, limit: int) -> Tried:
        """Plant one fault, run the tests, and take it out again."""
        path = copy / mutant.file
        content = path.read_text(encoding="utf-8")
        path.write_text(mutant.source(content), encoding="utf-8")
        try:
            return try_tests(copy, room, limit, lambda: NearestFirst(mutant, trace))
        finally:
            path.write_text(content, encoding="utf-8")


def _print_table(rows: list[dict[str, Any]]) -> None:
    """Print outcomes by room, and the faults that survived."""
    table = Table("room", "mutants", "killed", "time", "survived")
    for room in dict.fromkeys(row["room"] for row in rows):
        counts = Counter(row["outcome"] for row in rows if row["room"] == room)
        table.add_row(room, *map(str, (counts.total(), *(counts[k] for k in ("killed", "time", "survived")))))
    console = Console()
    console.print(table)
    for row in rows:
        if row["outcome"] == "survived":
            mutant = Mutant(**row["mutant"])
            place = f"{mutant.file}:{mutant.start[0]}:{mutant.start[1]}"
            console.print(f"{row['room']} {place} {mutant.kind}: {mutant.text}", markup=False, soft_wrap=True)


if __name__ == "__main__":
    tyro.cli(Mutants).run()
