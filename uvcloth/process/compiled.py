"""Compilation of loops by Numba, kept on disk from one process to the next.

A child process compiles, and this one loads. A function that was compiled here would call other functions in
the form that each has alone; a loaded one calls the copies of them in its own file. Fast arithmetic rounds
the two in different ways. So the first run after an installation would give other bytes than later ones.
"""

import atexit
import hashlib
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator

from rasterize.cache_folder import temporary_cache

Function = TypeVar("Function", bound=Callable[..., Any])

CACHE_VARIABLE = "UVCLOTH_CACHE"
"""Environment variable that names the folder of compiled loops; by default it is in the user's cache."""

DONE, FAILED = b"1", b"0"
"""Answers of the child process to a task."""


def compiled(function: Function) -> Function:
    """Compile a loop at its first call, and keep the machine code for later processes."""
    return _kept(function)


def borrowing(function: Function) -> Function:
    """Compile a loop that makes and returns no arrays.

    It does not count references to arrays, which can take most of the time where small functions get many.
    """
    return _kept(function, _nrt=False)


class _Locator(_CacheLocator):
    """Place of the files of a function: the folder of its sources' hash, wherever they are installed."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        self.folder = _cache_folder(Path(file).parent)
        self.line = function.__code__.co_firstlineno

    def get_cache_path(self) -> str:
        return str(self.folder)

    def get_source_stamp(self) -> str:
        return ""  # the hash is in the name of the folder

    def get_disambiguator(self) -> str:
        return str(self.line)

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> "_Locator":
        return cls(function, file)


class _Files(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012


class ChildCache(FunctionCache):
    """Numba's files of a compiled function; where they lack it, a child process compiles it into them.

    compiles_here: True in that child, and after a child was of no use (on a full disk).
    """

    _impl_class = _Files
    compiles_here = False

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the function for the types of its arguments, or None if it is to be compiled here."""
        loaded = super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        importable = self._py_func.__module__ != "__main__"
        if loaded is None and importable and not ChildCache.compiles_here:
            if _compile_in_child(self._py_func, sig):
                loaded = super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
            ChildCache.compiles_here = loaded is None
        return loaded

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save the function, if the disk lets us."""
        with suppress(OSError):
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]


def _kept(function: Function, **options: Any) -> Function:
    options = {"fastmath": True, "error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True, **options}
    dispatcher: Any = numba.njit(function, **options)
    if _cache_folder(Path(function.__code__.co_filename).parent) is not None:
        dispatcher._cache = ChildCache(function)
    return dispatcher


def _compile_in_child(function: Callable[..., Any], types: Any) -> bool:
    """Compile a function in a child process into its files. Returns False if that failed."""
    try:
        task = pickle.dumps((function.__module__, function.__qualname__, types))
    except (pickle.PicklingError, TypeError, AttributeError):
        return False
    # A child that has waited for long ends, and leaves the task to another one.
    return (_answer(task) or _answer(task)) == DONE


def _answer(task: bytes) -> bytes:
    """The answer of the child process to a task; nothing if there is no child."""
    if (child := _child(os.getpid())) is None:
        return b""
    answer = b""
    try:
        assert child.stdin is not None
        assert child.stdout is not None
        with suppress(BrokenPipeError):
            child.stdin.write(task)
            child.stdin.flush()
            answer = child.stdout.read(1)
    finally:
        if not answer:
            _end(child)
    return answer


@cache
def _child(parent: int) -> "subprocess.Popen[bytes] | None":
    """The child process that compiles for a process; its pipes close, and it ends, however that one ends."""
    from uvcloth.process import compiling

    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    try:
        child = subprocess.Popen(
            [sys.executable, "-P", "-m", compiling.__name__],
            env={**os.environ, "PYTHONPATH": paths},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
    except OSError:
        return None
    for pipe in filter(None, (child.stdin, child.stdout)):
        atexit.register(pipe.close)
    # A child that has ended by itself leaves the table of processes at once.
    threading.Thread(target=child.wait, daemon=True).start()
    return child


def _end(child: "subprocess.Popen[bytes]") -> None:
    child.kill()
    child.communicate()
    _child.cache_clear()


def inlined(function: Function) -> Function:
    """Compile a small function into its callers, so that loops over it are vectorized."""
    # Python calls none of them: without wrappers they compile in a sixth less time.
    options: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    dispatcher: Function = numba.njit(
        function, fastmath=True, error_model="numpy", forceinline=True, **options
    )
    return dispatcher


def is_kept(function: Any) -> bool:
    """True if a `compiled` function has been compiled for this source, by this process or one before."""
    code = function.py_func.__code__
    folder = _cache_folder(Path(code.co_filename).parent)
    return folder is not None and any(folder.rglob(f"{Path(code.co_filename).stem}.{code.co_name}-*.nbi"))


@cache
def _cache_folder(sources: Path) -> Path | None:
    """Folder of the compiled loops of the package folder `sources`, or None if none can be written.

    Numba would look at the file of a function alone, not at those of functions which it calls or at how it
    is compiled here: the hash of all does. So compiled loops call none of other package folders.
    """
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for path in sorted(sources.glob("*.py")):
        digest.update(path.read_bytes())
    name = f"{sources.name}-{digest.hexdigest()[:16]}"
    for root in (*_cache_roots(), None):
        try:
            folder = (root or temporary_cache("uvcloth-cache")) / name
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return None


def _cache_roots() -> list[Path]:
    named = os.environ.get(CACHE_VARIABLE)
    usual = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    roots = [Path(usual) / "uvcloth"]
    return [Path(named), *roots] if named else roots
