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
    "reach": (0.0, 1e6),
}
"""Least and greatest value of every number."""


@dataclass(frozen=True)
class WrinkleConfig:
    """Sizes of the network, and what it serves."""

    size: int = 128
    """Height and width of every map."""
    width: int = 24
    """Channels at half of that size; each of the next levels has half as many more."""
    levels: int = 4
    """Times that maps are halved."""
    reach: float = 5.0
    """Limit of scaled inputs."""
    gain: float = 1.0
    """Factor on displacements when they are shown: a network that is not sure makes weak folds."""
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


class WrinkleNet(nn.Module):
    """Maps (B, CHANNELS, H, W) -> displacements (B, 3, H, W), m, along u, v and the outward normal.

    Half the size is the finest that is computed on; the last layer deals four texels out of each place.
    """

    input_shift: Tensor
    input_scale: Tensor
    output_scale: Tensor

    def __init__(self, config: WrinkleConfig) -> None:
        super().__init__()
        self.config = config
        widths = [round(config.width * 1.5**level) for level in range(config.levels)]
        self.register_buffer("input_shift", torch.zeros(CHANNELS, 1, 1))
        self.register_buffer("input_scale", torch.ones(CHANNELS, 1, 1))
        self.register_buffer("output_scale", torch.full((3, 1, 1), 0.005))
        self.first = nn.Conv2d(CHANNELS, widths[0], 4, stride=2, padding=1)
        self.down = nn.ModuleList(
            nn.Conv2d(before, after, 4, stride=2, padding=1) for before, after in pairwise(widths)
        )
        self.across = nn.ModuleList(nn.Conv2d(width, width, 3, padding=1) for width in widths)
        self.up = nn.ModuleList(
            nn.Conv2d(deep + width, width, 3, padding=1) for width, deep in pairwise(widths)
        )
        self.last = nn.Conv2d(widths[0], 12, 3, padding=1)
        for parameter in self.last.parameters():
            nn.init.zeros_(parameter)

    def forward(self, maps: Tensor) -> Tensor:
        """Displacements (B, 3, H, W) m, of input maps (B, CHANNELS, H, W)."""
        reach = self.config.reach
        x = (maps - self.input_shift * maps[:, -1:]) * self.input_scale
        x = torch.nn.functional.silu(self.first(x.clamp(-reach, reach)))
        skips: list[Tensor] = []
        for level, across in enumerate(self.across):
            x = x + torch.nn.functional.silu(across(x))
            skips.append(x)
            if level < len(self.down):
                x = torch.nn.functional.silu(self.down[level](x))
        for level in reversed(range(len(self.up))):
            larger = torch.nn.functional.interpolate(
                x, size=skips[level].shape[-2:], mode="bilinear", align_corners=False
            )
            x = torch.nn.functional.silu(self.up[level](torch.cat([larger, skips[level]], dim=1)))
        dealt: Tensor = torch.nn.functional.pixel_shuffle(self.last(x), 2)
        return dealt * self.output_scale
