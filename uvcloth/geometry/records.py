"""Dataclasses of tensors as arrays for an npz, and on another device."""

from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar, cast, get_type_hints

import numpy as np
import torch
from torch import Tensor

Record = TypeVar("Record")
"""A dataclass whose fields are tensors, numbers and other such dataclasses."""

Value = TypeVar("Value")

CPU = torch.device("cpu")


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


def to_device(value: Value, device: torch.device) -> Value:
    """The same with all its tensors on a device: those in dataclasses, tuples, lists and dicts, at any depth.

    All other objects are returned as they are, such as modules, which have their own `to`.
    """
    copy: Any = value
    if isinstance(value, Tensor):
        copy = value.to(device)
    elif is_dataclass(value) and not isinstance(value, type):
        copy = replace(value, **{f.name: to_device(getattr(value, f.name), device) for f in fields(value)})
    elif isinstance(value, tuple | list):
        copy = type(value)(to_device(each, device) for each in value)
    elif isinstance(value, dict):
        copy = {key: to_device(each, device) for key, each in value.items()}
    return cast(Value, copy)
