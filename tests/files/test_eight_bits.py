"""Tensors in eight bits are off by half a step of their row at most."""

import pytest
import torch

from uvcloth.files.eight_bits import from_eight_bits, in_eight_bits


def test_values_are_half_a_step_off_at_most_whatever_their_size() -> None:
    generator = torch.Generator().manual_seed(3)
    sizes = torch.tensor([0.0, 1e-9, 1e-3, 1.0, 300.0])
    weight = sizes[:, None, None] * torch.randn(5, 7, 3, generator=generator)
    bias = torch.randn(5, generator=generator)
    packed = in_eight_bits({"weight": weight, "bias": bias}, lambda name: name == "weight")
    assert packed["weight"].dtype == torch.int8
    assert packed["weight"].numel() == weight.numel()
    whole = from_eight_bits(packed)
    assert whole.keys() == {"weight", "bias"}
    assert torch.equal(whole["bias"], bias)
    greatest = weight.abs().amax((1, 2))
    off = (whole["weight"] - weight).abs().amax((1, 2))
    assert torch.all(off <= greatest / 253)
    assert torch.all(off[1:] > greatest[1:] / 2540)


def test_scales_without_their_tensor_are_refused() -> None:
    with pytest.raises(KeyError, match="weight"):
        from_eight_bits({"weight.rows": torch.ones(2, 1)})
