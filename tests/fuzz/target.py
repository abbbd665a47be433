"""Readers to try: a target makes good files, reads them, and checks what came out."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import torch
from torch import Tensor

Mutator = Callable[[Path, Random], str]
"""Changes a file in place and says in words what it did."""


@dataclass(frozen=True)
class Target:
    """One reader.

    make: writes good files into an empty folder and returns the path that `read` takes. read: raises
    InputError, whose sentence names the file or the folder, or returns a value. check: raises AssertionError
    (see `require`) if the value is not what the reader promises. mutators: besides those of a file's suffix.
    share: of the cases that the test suite tries, for a reader that takes long.
    """

    name: str
    make: Callable[[Path], Path]
    read: Callable[[Path], Any]
    check: Callable[[Any], None]
    mutators: tuple[Mutator, ...] = ()
    share: float = 1.0


def require(holds: bool | Tensor, what: str) -> None:
    """Raise AssertionError that says what is wrong with a value, unless something holds."""
    if not bool(holds):
        raise AssertionError(what)


def require_numbers(
    values: Tensor, shape: tuple[int, ...], what: str, dtype: torch.dtype = torch.float32
) -> None:
    """Raise AssertionError unless a tensor has a shape (-1 for any) and a type, and is finite."""
    fits = values.ndim == len(shape) and all(a in (-1, b) for a, b in zip(shape, values.shape, strict=True))
    require(fits, f"{what} has the shape {tuple(values.shape)}, expected {shape}")
    require(values.dtype == dtype, f"{what} is {values.dtype}, expected {dtype}")
    require(torch.isfinite(values).all(), f"{what} is not finite")


def require_indices(values: Tensor, shape: tuple[int, ...], end: int, what: str) -> None:
    """Raise AssertionError unless int64 values have a shape (-1 for any) and lie from 0 up to `end`."""
    require_numbers(values, shape, what, torch.int64)
    require(values.numel() == 0 or (values.min() >= 0 and values.max() < end), f"{what} is out of range")
