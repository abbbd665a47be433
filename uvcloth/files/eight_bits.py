"""Tensors in eight bits with a scale for each row: half the size of half precision."""

from collections.abc import Callable, Mapping

import torch
from torch import Tensor

ROWS = ".rows"
"""End of the name of the scales of a tensor."""

STEPS = 127.0
"""Steps from zero to the greatest value of a row."""

SMALLEST = 1e-30
"""Least step: a row of zeros has one too."""


def in_eight_bits(tensors: Mapping[str, Tensor], which: Callable[[str], bool]) -> dict[str, Tensor]:
    """Tensors of which those named are whole numbers (R, ...), and have scales (R, 1, ...).

    which: True for a name. A value is at most half a step off: 1/254 of the greatest in its row.
    """
    packed = dict(tensors)
    for name in filter(which, tensors):
        values = tensors[name].float()
        scales = values.abs().amax(tuple(range(1, values.ndim)), keepdim=True) / STEPS
        packed[name] = (values / scales.clamp(min=SMALLEST)).round().to(torch.int8)
        packed[name + ROWS] = scales
    return packed


def from_eight_bits(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The tensors of which `in_eight_bits` packed some. Raises KeyError for scales of nothing."""
    whole = {name: tensor for name, tensor in tensors.items() if not name.endswith(ROWS)}
    for name in tensors.keys() - whole.keys():
        values = name.removesuffix(ROWS)
        whole[values] = whole[values] * tensors[name]
    return whole
