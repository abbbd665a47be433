"""The discriminator's patches, and its labels against the cross-entropy written out."""

import pytest
import torch
from torch.nn.functional import softplus

from train.physxnet.patchgan import PatchGAN, discriminator_loss, generator_loss


def test_a_logit_sees_one_patch_and_no_more() -> None:
    """Three strided convolutions of four and one more: patches of 46 texels, eight apart."""
    torch.manual_seed(0)
    net = PatchGAN(5, 4).eval()
    maps = torch.randn(2, 5, 64, 64)
    other = maps.clone()
    other[:, :, 0, 63] += 1.0
    with torch.no_grad():
        before, changed = net(maps), net(other)
    assert before.shape == (2, 1, 7, 7)
    # Logit k sees texels 8 k - 15 to 8 k + 30.
    sees = torch.zeros(7, 7, dtype=torch.bool)
    sees[:2, 5:] = True
    assert torch.equal((before != changed).any(0)[0], sees)


def test_the_generator_pays_for_logits_that_say_made() -> None:
    logits = torch.tensor([[[[0.0, 2.0]]], [[[-1.0, -3.0]]]])
    expected = sum(torch.log1p(torch.exp(-x)) for x in logits.flatten()) / 4
    torch.testing.assert_close(generator_loss(logits), expected)


@pytest.mark.parametrize("sure", [0.0, 3.0, -3.0])
def test_labels_are_soft_and_some_are_flipped(sure: float) -> None:
    """Cross-entropy softplus(x) - x y is linear in the label y, so the mean label is what counts."""
    torch.manual_seed(0)
    real = torch.full((20000, 1, 2, 2), sure)
    # The paper's labels: 0.7 to 1 and 0 to 0.3, one in twenty of them flipped.
    labels = [0.95 * mean + 0.05 * (1.0 - mean) for mean in (0.85, 0.15)]
    expected = sum(
        float(softplus(torch.tensor(x))) - x * y for x, y in zip((sure, -sure), labels, strict=True)
    )
    assert discriminator_loss(real, -real).item() == pytest.approx(expected, abs=0.02)
