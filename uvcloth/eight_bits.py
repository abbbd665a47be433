"""Tensors in eight bits with a scale for each row: half the size of half precision."""

from collections.abc import Callable, Mapping

import torch
from torch import Tensor

ROWS = ".rows"
"""End of the name of the scales of a tensor."""

STEPS = 127.0
"""Steps from zero to the greatest value of a row."""


def in_eight_bits(tensors: Mapping[str, Tensor], chosen: Callable[[str], bool]) -> dict[str, Tensor]:
    """Tensors of which the chosen (R, ..., C) are whole numbers from -127 to 127, and have scales (R, ..., 1).

    A value is at most half a step off: 1/254 of the greatest in its row.
    """
    packed = dict(tensors)
    for name in filter(chosen, tensors):
        values = tensors[name].float()
        scales = (values.abs().amax(-1, keepdim=True) / STEPS).half()
        packed[name] = (values / scales.float().clamp(min=torch.finfo(torch.half).tiny)).round().to(torch.int8)
        packed[name + ROWS] = scales
    return packed


def from_eight_bits(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The tensors of which `in_eight_bits` made some. Raises KeyError for scales of nothing."""
    whole = {name: tensor for name, tensor in tensors.items() if not name.endswith(ROWS)}
    for name in tensors.keys() - whole.keys():
        values = name.removesuffix(ROWS)
        whole[values] = whole[values].float() * tensors[name].float()
    return whole
