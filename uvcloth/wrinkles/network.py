"""The wrinkle network: a small U-Net from maps of a smooth surface to maps of what is missing on it."""

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn

from uvcloth.errors import InputError
from uvcloth.files.settings import require_settings
from uvcloth.wrinkles.inputs import CHANNELS

RANGES: dict[str, tuple[float, float]] = {
    "size": (8, 1024),
    "width": (1, 256),
    "levels": (1, 6),
    "gain": (0.0, 10.0),
    "lag": (0.0, 10.0),
    "reach": (0.0, 1e6),
}
"""Least and greatest value of every number."""


@dataclass(frozen=True)
class WrinkleConfig:
    """Sizes of the network, and what it serves."""

    size: int = 128
    """Height and width of every map."""
    width: int = 16
    """Channels at half of that size; each of the next levels has half as many more."""
    levels: int = 4
    """Times that maps are halved."""
    reach: float = 5.0
    """Limit of scaled inputs."""
    gain: float = 1.0
    """Factor on displacements when they are shown: a network that is not sure makes weak folds."""
    lag: float = 0.03
    """Seconds after which displacements that are shown have gone 63 % of the way to new ones: folds stay."""
    quality: str = "default"
    """Quality of the cage whose wrinkles it makes."""
    garments: tuple[str, ...] = ("tops",)
    """Garments that it was trained on."""

    def __post_init__(self) -> None:
        """Raises InputError for values out of range, and if the levels do not halve the size evenly."""
        require_settings(self, RANGES)
        if self.size % 2**self.levels:
            raise InputError(
                f"--size {self.size}: has to be a multiple of {2**self.levels} for --levels {self.levels}"
            )


class TexelGain(nn.Module):
    """Channels (B, C, H, W) times a gain of each texel, plus its offset: maps that differ over a garment.

    Linear maps before and after it are the same at all texels; with it between them each has one.
    """

    def __init__(self, channels: int, size: int) -> None:
        super().__init__()
        self.gain = nn.Parameter(torch.ones(1, channels, size, size))
        self.offset = nn.Parameter(torch.zeros(1, channels, size, size))

    def forward(self, x: Tensor) -> Tensor:
        """The channels (B, C, H, W)."""
        return x * self.gain + self.offset


class WrinkleNet(nn.Module):
    """Maps (B, CHANNELS, H / 2, W / 2) -> displacements (B, 12, H / 2, W / 2), m.

    These are along u, v and the outward normal, each at the four quarters of a texel.
    """

    input_shift: Tensor
    input_scale: Tensor
    output_scale: Tensor

    def __init__(self, config: WrinkleConfig) -> None:
        super().__init__()
        self.config = config
        widths = [round(config.width * 1.5**level) for level in range(config.levels)]
        sizes = [config.size // 2 >> level for level in range(config.levels)]
        self.register_buffer("input_shift", torch.zeros(CHANNELS, 1, 1))
        self.register_buffer("input_scale", torch.ones(CHANNELS, 1, 1))
        self.register_buffer("output_scale", torch.full((12, 1, 1), 0.005))
        self.first = nn.Conv2d(CHANNELS, widths[0], 1)
        self.here = nn.ModuleList(TexelGain(width, size) for width, size in zip(widths, sizes, strict=True))
        self.down = nn.ModuleList(
            nn.Conv2d(before, after, 4, stride=2, padding=1) for before, after in pairwise(widths)
        )
        self.across = nn.ModuleList(nn.Conv2d(width, width, 3, padding=1) for width in widths)
        self.narrow = nn.ModuleList(nn.Conv2d(deep, width, 1) for width, deep in pairwise(widths))
        self.up = nn.ModuleList(nn.Conv2d(width, width, 3, padding=1) for width in widths[:-1])
        self.end = TexelGain(widths[0], sizes[0])
        self.last = nn.Conv2d(widths[0], 12, 3, padding=1)
        self.mean = nn.Parameter(torch.zeros(1, 12, sizes[0], sizes[0]))
        for parameter in self.last.parameters():
            nn.init.zeros_(parameter)

    def forward(self, maps: Tensor) -> Tensor:
        """Displacements (B, 12, H / 2, W / 2) m, of input maps (B, CHANNELS, H / 2, W / 2)."""
        silu, reach = nn.functional.silu, self.config.reach
        scaled = torch.addcmul(maps * self.input_scale, maps[:, -1:], -self.input_shift * self.input_scale)
        x = silu(self.here[0](self.first(scaled.clamp(-reach, reach))))
        skips: list[Tensor] = []
        for level, across in enumerate(self.across):
            x = x + silu(across(x))
            skips.append(x)
            if level < len(self.down):
                x = silu(self.here[level + 1](self.down[level](x)))
        for level in reversed(range(len(self.up))):
            narrow = self.narrow[level](x)
            x = skips[level] + nn.functional.interpolate(narrow, scale_factor=2.0, mode="bilinear")
            x = x + silu(self.up[level](x))
        made: Tensor = (self.last(self.end(x)) + self.mean) * self.output_scale
        return made


def dealt(maps: Tensor) -> Tensor:
    """Displacements (B, 3, H, W) of those at quarters, (B, 12, H / 2, W / 2)."""
    return nn.functional.pixel_shuffle(maps, 2)
