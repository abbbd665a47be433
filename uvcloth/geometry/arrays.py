"""Arrays that callers of the library pass: NumPy's, tensors on any device, nested lists."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.errors import InputError, cause
from uvcloth.files.fields import Field, check_fields

Array: TypeAlias = NDArray[Any] | Tensor | list[Any]
"""A NumPy array, a tensor on any device, or nested lists of numbers."""


def check_arrays(
    owner: str, arrays: Mapping[str, Array], fields: Mapping[str, Field], **sizes: int
) -> dict[str, np.ndarray]:
    """Arrays of a caller, checked and converted as those of a file are.

    owner: name for error messages. The results share no memory with the input. Raises InputError as
    `check_fields` does, and for values that are not arrays.
    """
    copies = {name: as_array(owner, name, values) for name, values in arrays.items()}
    return check_fields(Path(owner), copies, fields, **sizes)


def as_array(owner: str, name: str, values: Array) -> np.ndarray:
    """A copy of a caller's value as a NumPy array. Raises InputError for a value that is not an array."""
    if isinstance(values, Tensor):
        values = values.detach().cpu().numpy()
    try:
        return np.array(values)
    except (ValueError, TypeError) as error:
        raise InputError(f"{owner}: {name} is not an array of numbers ({cause(error)})") from error
