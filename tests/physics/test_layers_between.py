"""Garments that others part."""

import math

import pytest
import torch
from torch import Tensor

from uvcloth.physics.layers_between import kept_apart


def tube(radius: float, height: float, around: int = 24, up: int = 12) -> tuple[Tensor, Tensor]:
    """Open tube around the z axis: vertices and faces."""
    turn = torch.arange(around) * (2.0 * math.pi / around)
    ring = torch.stack([radius * turn.cos(), radius * turn.sin(), torch.zeros(around)], 1)
    vertices = torch.cat([ring + torch.tensor([0.0, 0.0, height * k / up]) for k in range(up + 1)])
    low = (torch.arange(up)[:, None] * around + torch.arange(around)).flatten()
    right = (torch.arange(up)[:, None] * around + (torch.arange(around) + 1) % around).flatten()
    above = torch.stack([low, right, right + around], 1)
    return vertices, torch.cat([above, torch.stack([low, right + around, low + around], 1)])


@pytest.mark.parametrize(("middle", "apart"), [(0.5, True), (0.2, False)])
def test_a_layer_parts_those_that_it_lies_between_everywhere(middle: float, apart: bool) -> None:
    garments = [tube(0.200, 0.5), tube(0.204, middle), tube(0.208, 0.5)]
    found = kept_apart(garments)
    assert bool(found[0, 2]) == bool(found[2, 0]) == apart
    assert int(found.sum()) == 2 * apart


def test_garments_that_are_far_from_each_other_may_meet() -> None:
    assert not kept_apart([tube(0.1, 0.5), tube(0.104, 0.5), tube(0.4, 0.5)])[0, 2]
