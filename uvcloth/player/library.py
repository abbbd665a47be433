"""The compiled runtime, loaded once: on x86-64 the one of two libraries that the processor runs faster."""

import sys
from ctypes import CDLL, c_float, c_int, c_int64, c_size_t, c_void_p
from functools import cache
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent
"""Where runtime/compile.py puts the libraries."""

SUFFIX = {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")
BASELINE, WIDE = f"libuvcloth{SUFFIX}", f"libuvcloth_v3{SUFFIX}"
"""The library for every processor of its kind, and that for x86-64-v3 (AVX2, FMA, BMI)."""

SIGNATURES: dict[str, tuple[Any, ...]] = {
    "uvc_new": (c_void_p, c_void_p),
    "uvc_saved_size": (c_size_t, c_void_p),
    "uvc_clearing_memory": (c_size_t, c_void_p),
    "uvc_wrinkle_memory": (c_size_t, c_void_p),
    "uvc_make_pairs": (c_void_p,),
    "uvc_stable_step": (c_float, c_void_p, c_void_p, c_void_p),
    "uvc_encode_numbers": (c_int64, c_void_p, c_int64, c_int64, c_int64, c_int64, c_void_p, c_int64),
    "uvc_decode_numbers": (c_int64, c_void_p, c_int64, c_void_p, c_int64, c_int64, c_int64, c_int64),
    "uvc_encode_section": (c_int64, c_void_p, c_int, c_int, c_void_p, c_int64),
    "uvc_decode_section": (c_int, c_void_p, c_int64, c_void_p, c_int, c_int),
}
"""Types of what functions of runtime/include return, None for nothing, and of their arguments."""


@cache
def library() -> CDLL:
    """The runtime's functions. Raises ImportError if it has not been compiled, or for another system."""
    baseline, wide = _load(FOLDER / BASELINE), FOLDER / WIDE
    baseline.uvc_has_v3.restype = c_int
    best = _load(wide) if baseline.uvc_has_v3() and wide.exists() else baseline
    for name, (returned, *arguments) in SIGNATURES.items():
        function = getattr(best, name)
        function.restype, function.argtypes = returned, arguments
    return best


def _load(path: Path) -> CDLL:
    cure = "reinstall uvcloth, or run `make install` in a checkout"
    if not path.exists():
        raise ImportError(f"{path} is missing: {cure}")
    try:
        return CDLL(str(path))
    except OSError as error:
        raise ImportError(f"{path} cannot be loaded, {error}: {cure}") from error
