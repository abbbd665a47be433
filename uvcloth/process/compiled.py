"""Compilation of loops by Numba, kept on disk from one process to the next."""

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

CACHE_VARIABLE = "UVCLOTH_CACHE"
"""Environment variable that names the folder of compiled loops; by default it is in the user's cache."""


def compiled(function: Function) -> Function:
    """Compile a loop at its first call, and keep the machine code for later processes."""
    return _kept(function)


def borrowing(function: Function) -> Function:
    """Compile a loop that makes and returns no arrays.

    It does not count references to arrays, which can take most of the time where small functions get many.
    """
    return _kept(function, _nrt=False)


def _kept(function: Function, **options: Any) -> Function:
    settings: Any = numba.config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(_cache_folder(Path(function.__code__.co_filename).parent))
    try:
        return numba.njit(function, cache=True, fastmath=True, error_model="numpy", nogil=True, **options)
    finally:
        settings.CACHE_DIR = before


def inlined(function: Function) -> Function:
    """Compile a small function into its callers, so that loops over it are vectorized."""
    return numba.njit(function, fastmath=True, error_model="numpy", forceinline=True)


def is_kept(function: Any) -> bool:
    """True if a `compiled` function has been compiled for this source, by this process or one before."""
    code = function.py_func.__code__
    folder = _cache_folder(Path(code.co_filename).parent)
    return any(folder.rglob(f"{Path(code.co_filename).stem}.{code.co_name}-*.nbi"))


@cache
def _cache_folder(sources: Path) -> Path:
    """Folder of the compiled loops of the package folder `sources`.

    Numba renews compiled code when its own file changes, not when that of a function changes which it calls:
    the hash of all files together does. So compiled loops call none of other package folders.
    """
    digest = hashlib.sha256()
    for path in sorted(sources.glob("*.py")):
        digest.update(path.read_bytes())
    name = f"{sources.name}-{digest.hexdigest()[:16]}"
    for root in _cache_roots():
        folder = root / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    raise AssertionError("the system's folder for temporary files cannot be written")


def _cache_roots() -> list[Path]:
    named = os.environ.get(CACHE_VARIABLE)
    usual = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    roots = [Path(usual) / "uvcloth", Path(tempfile.gettempdir()) / "uvcloth-cache"]
    return [Path(named), *roots] if named else roots
