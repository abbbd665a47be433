"""The paper's discriminator, and the labels that it is trained on (section 4.4)."""

from itertools import pairwise

import torch
from torch import Tensor, nn

FAKE_LABELS = (0.0, 0.3)
REAL_LABELS = (0.7, 1.0)
FLIPPED = 0.05
"""Share of samples whose label says the opposite."""


class PatchGAN(nn.Module):
    """Judges overlapping patches of body and garment maps: (B, C, H, W) -> logits (B, 1, h, w)."""

    def __init__(self, channels: int, width: int) -> None:
        super().__init__()
        widths = (channels, width, width * 2, width * 4)
        layers: list[nn.Module] = []
        for before, after in pairwise(widths):
            layers += [nn.Conv2d(before, after, 4, stride=2, padding=1)]
            layers += [nn.BatchNorm2d(after)] if before != channels else []
            layers += [nn.LeakyReLU(0.2, inplace=True)]
        self.layers = nn.Sequential(*layers, nn.Conv2d(widths[-1], 1, 4, padding=1))

    def forward(self, maps: Tensor) -> Tensor:
        """Maps (B, C, H, W) -> logits of overlapping patches (B, 1, h, w)."""
        return self.layers(maps)


def discriminator_loss(real: Tensor, made: Tensor) -> Tensor:
    """Sigmoid cross-entropy of logits against soft labels, some of them flipped (eq. 1)."""
    flipped = torch.rand(len(real), 1, 1, 1, device=real.device) < FLIPPED
    high = torch.empty_like(real).uniform_(*REAL_LABELS)
    low = torch.empty_like(made).uniform_(*FAKE_LABELS)
    cross_entropy = nn.functional.binary_cross_entropy_with_logits
    return cross_entropy(real, torch.where(flipped, low, high)) + cross_entropy(
        made, torch.where(flipped, high, low)
    )


def generator_loss(made: Tensor) -> Tensor:
    """Loss of the generator for maps that are taken for made ones (eq. 2, first term)."""
    return nn.functional.binary_cross_entropy_with_logits(made, torch.ones_like(made))
