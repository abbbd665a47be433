"""The network of PhysXNet: one body encoder, one garment decoder per template (section 3.2, figure 2)."""

import torch
from torch import Tensor, nn

KERNEL = 4
"""Kernel of every strided convolution: it halves or doubles a map exactly (pix2pix, the paper's [12])."""


class GroupNorm(nn.GroupNorm):
    """Group normalization with the same sums on any number of threads, unlike torch's with channels last."""

    def forward(self, input: Tensor) -> Tensor:
        """Normalize maps (B, C, H, W)."""
        return super().forward(input.contiguous())


def normalization(kind: str, channels: int) -> nn.Module:
    """A normalization layer by name: "batch", "group" (of eight channels), "instance" or "none"."""
    if kind == "batch":
        return nn.BatchNorm2d(channels)
    if kind == "group":
        return GroupNorm(max(1, channels // 8), channels)
    if kind == "instance":
        return nn.InstanceNorm2d(channels, affine=True)
    if kind == "none":
        return nn.Identity()
    raise ValueError(f"normalization {kind!r}: expected batch, group, instance or none")


def upsampling(kind: str, inputs: int, outputs: int) -> nn.Module:
    """A layer that doubles a map: "transposed" convolution, or "resize", bilinear enlargement.

    The latter comes after a 3 x 3 convolution, on the map at a quarter of the size.
    """
    if kind == "transposed":
        return nn.ConvTranspose2d(inputs, outputs, KERNEL, stride=2, padding=1)
    if kind == "resize":
        return nn.Sequential(
            nn.Conv2d(inputs, outputs, 3, padding=1),
            nn.Upsample(scale_factor=2, mode="bilinear", align_corners=False),
        )
    raise ValueError(f"upsampling {kind!r}: expected transposed or resize")


def encoder_layer(inputs: int, outputs: int, norm: str) -> nn.Sequential:
    """Convolution to half the size, normalization, ReLU."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, KERNEL, stride=2, padding=1),
        normalization(norm, outputs),
        nn.ReLU(inplace=True),
    )


def decoder_layer(inputs: int, outputs: int, norm: str, upsample: str) -> nn.Sequential:
    """Enlargement to double the size, normalization, ReLU."""
    return nn.Sequential(
        upsampling(upsample, inputs, outputs), normalization(norm, outputs), nn.ReLU(inplace=True)
    )


class Decoder(nn.Module):
    """From the encoder's maps to one garment's offset map, with skip connections."""

    def __init__(self, widths: tuple[int, ...], channels: int, norm: str, upsample: str) -> None:
        super().__init__()
        deeper = list(reversed(widths))
        layers = [
            decoder_layer(deeper[level] * (1 if level == 0 else 2), deeper[level + 1], norm, upsample)
            for level in range(len(deeper) - 1)
        ]
        self.layers = nn.ModuleList(layers)
        self.output = upsampling(upsample, deeper[-1] * 2, channels)

    def forward(self, skips: list[Tensor]) -> Tensor:
        """skips: the encoder's maps, largest first."""
        x = skips[-1]
        for layer, skip in zip(self.layers, reversed(skips[:-1]), strict=True):
            x = torch.cat([layer(x), skip], dim=1)
        return self.output(x)


class UNet(nn.Module):
    """The U-Net: maps (B, inputs, H, W) -> (B, decoders * 3, H, W).

    H and W: multiples of 2 to the number of levels.
    width: channels of the first level; each of the next doubles them, up to eight times.
    dropout: share of the deepest level's channels that training drops.
    """

    def __init__(
        self, *, inputs: int, decoders: int, width: int, levels: int, norm: str, upsample: str, dropout: float
    ) -> None:
        super().__init__()
        widths = tuple(width * min(2**level, 8) for level in range(levels))
        self.encoder = nn.ModuleList(
            encoder_layer(before, after, norm)
            for before, after in zip((inputs, *widths[:-1]), widths, strict=True)
        )
        self.dropout = nn.Dropout2d(dropout)
        self.decoders = nn.ModuleList(Decoder(widths, 3, norm, upsample) for _ in range(decoders))

    def forward(self, x: Tensor) -> Tensor:
        """Maps (B, inputs, H, W) -> (B, decoders * 3, H, W)."""
        skips: list[Tensor] = []
        for layer in self.encoder:
            x = layer(x)
            skips.append(x)
        skips[-1] = self.dropout(skips[-1])
        return torch.cat([decoder(skips) for decoder in self.decoders], dim=1)
