"""The number of threads of a command; the calling program gets its own number back."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from uvcloth.errors import InputError


@contextmanager
def limited_threads(count: int) -> Iterator[None]:
    """Run the block on a number of CPU threads.

    Raises InputError for less than one. On a loaded machine several threads wait for each other.
    """
    if count < 1:
        raise InputError(f"--threads {count}: expected 1 or more")
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
