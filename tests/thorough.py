"""Parameters of a test of which some are tried always, and the others with --thorough."""

from collections.abc import Iterable
from typing import Any

import pytest


def always(kept: Iterable[Any], values: Iterable[Any]) -> list[Any]:
    """All values as parameters: those that are kept as they are, the others marked as thorough."""
    kept = tuple(kept)
    return [
        value
        if value in kept
        else pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.thorough)
        for value in values
    ]
