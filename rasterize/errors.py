"""The one error for bad input; every command prints its sentence and exits with code 2."""

LONGEST = 120
"""Characters of what another library says that an error repeats."""


class InputError(ValueError):
    """Bad input from a user: the message is one sentence that names the file and the place."""


def cause(error: BaseException) -> str:
    """Text of another library's error, on one line, not longer than LONGEST; its kind where it is empty."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
