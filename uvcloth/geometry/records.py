"""Dataclasses of tensors as arrays for an npz, and on a device."""

from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, cast, get_type_hints

import numpy as np
import torch
from torch import Tensor

Record = TypeVar("Record")
"""A dataclass whose fields are tensors, numbers and other such dataclasses."""


def to_arrays(record: Any, prefix: str) -> dict[str, np.ndarray]:
    """The fields of a record as arrays for an npz."""
    arrays: dict[str, np.ndarray] = {}
    for f in fields(record):
        value, name = getattr(record, f.name), f"{prefix}.{f.name}"
        arrays |= to_arrays(value, name) if is_dataclass(value) else {name: np.asarray(value)}
    return arrays


def from_arrays(kind: type[Record], arrays: dict[str, np.ndarray], prefix: str) -> Record:
    """The record that `to_arrays` wrote. Raises KeyError if an array is missing."""
    values: dict[str, Any] = {}
    for name, hint in get_type_hints(kind).items():
        if is_dataclass(hint):
            values[name] = from_arrays(cast(type, hint), arrays, f"{prefix}.{name}")
        else:
            array = arrays[f"{prefix}.{name}"]
            values[name] = torch.from_numpy(array) if hint is Tensor else hint(array)
    return kind(**values)


def to_device(record: Record, device: torch.device) -> Record:
    """The record with its tensors on a device."""
    values: dict[str, Any] = {}
    for name in get_type_hints(type(record)):
        value = getattr(record, name)
        if isinstance(value, Tensor):
            value = value.to(device)
        values[name] = to_device(value, device) if is_dataclass(value) else value
    return type(record)(**values)
