"""Records of tensors: from device to device, whatever holds them."""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from uvcloth.geometry.records import to_device

ELSEWHERE = torch.device("meta")


@dataclass(frozen=True)
class Inner:
    values: Tensor
    scale: float


@dataclass(frozen=True)
class Outer:
    parts: tuple[Inner, ...]
    named: dict[str, list[Tensor]]
    missing: Tensor | None
    anything: Any


def test_tensors_at_any_depth_move_and_all_else_stays() -> None:
    module = torch.nn.Linear(1, 1)
    inner = Inner(torch.zeros(2), 0.5)
    record = Outer((inner, inner), {"a": [torch.ones(3)]}, None, module)
    moved = to_device(record, ELSEWHERE)
    assert [part.values.device for part in moved.parts] == [ELSEWHERE, ELSEWHERE]
    assert moved.named["a"][0].device == ELSEWHERE
    assert isinstance(moved.parts, tuple)
    assert moved.parts[0].scale == 0.5
    assert moved.missing is None
    assert moved.anything is module
    assert record.parts[0].values.device == torch.device("cpu"), "the record itself must not change"


def test_a_tuple_of_records_moves_at_once() -> None:
    first, second = to_device((Inner(torch.zeros(1), 1.0), torch.zeros(2)), ELSEWHERE)
    assert first.values.device == second.device == ELSEWHERE
