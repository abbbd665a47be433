"""Registry of the cloth engines by name."""

from collections.abc import Callable

from uvcloth.errors import InputError
from uvcloth.simulation.blender import find_blender
from uvcloth.simulation.engine import Engine
from uvcloth.simulation.explicit import Explicit

ENGINES: dict[str, Callable[[], Engine]] = {"explicit": Explicit, "blender": find_blender}
"""Functions that make each; they raise InputError if the engine is not installed."""


def require_engine_name(name: str) -> None:
    """Raise InputError for a name that is not in ENGINES."""
    if name not in ENGINES:
        raise InputError(f"--engine {name}: expected one of {', '.join(ENGINES)}")
