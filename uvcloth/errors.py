"""The one error for bad input; every command prints its sentence and exits with code 2."""

from rasterize.errors import InputError

__all__ = ["InputError", "cause"]

LONGEST = 120
"""Characters of what another library says that an error repeats."""


def cause(error: BaseException) -> str:
    """Text of another library's error, on one line, not longer than LONGEST; its kind where it is empty."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
