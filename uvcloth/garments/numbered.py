"""Vertices that a text file names by their numbers."""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.files.reading import read_content


def numbered(path: Path, count: int, name: str) -> Tensor:
    """The vertices whose numbers, from 0, a text file lists: (N,) bool. name: of what has so many of them.

    Raises InputError naming the file if it cannot be read, for what is no number, and for one that no vertex
    has.
    """
    try:
        text = read_content(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected vertex numbers in UTF-8") from error
    try:
        numbers = np.array(text.split(), dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise InputError(f"{path}: expected vertex numbers, {str(error)[:80]!r}") from error
    if len(numbers) and not 0 <= numbers.min() <= numbers.max() < count:
        wrong = int(numbers[(numbers < 0) | (numbers >= count)][0])
        raise InputError(f"{path}: vertex {wrong} is not one of the {count} of {name}")
    return torch.zeros(count, dtype=torch.bool).index_fill(0, torch.from_numpy(numbers), True)
