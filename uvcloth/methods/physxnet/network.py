"""The network of PhysXNet: a U-Net from motion maps to offset maps, scaled to metres (section 3)."""

import torch
from torch import Tensor, nn

from uvcloth.methods.physxnet.config import PhysXNetConfig
from uvcloth.methods.physxnet.unet import UNet


class GarmentNet(nn.Module):
    """The U-Net between maps in metres and seconds: scales what goes in and what comes out.

    The statistics are buffers, so that they are saved with the weights; output_shift is (channels, 1, 1) or,
    centred per texel, (channels, H, W).
    """

    input_shift: Tensor
    input_scale: Tensor
    output_shift: Tensor
    output_scale: Tensor

    def __init__(self, config: PhysXNetConfig) -> None:
        super().__init__()
        self.reach = config.reach
        outputs = 3 * len(config.templates)
        sheet = (config.size, config.size) if config.centre == "texel" else (1, 1)
        self.unet = UNet(
            inputs=config.inputs,
            decoders=len(config.templates),
            width=config.width,
            levels=config.levels,
            norm=config.norm,
            upsample=config.upsample,
            dropout=config.dropout,
        )
        self.register_buffer("input_shift", torch.zeros(config.inputs, 1, 1))
        self.register_buffer("input_scale", torch.ones(config.inputs, 1, 1))
        self.register_buffer("output_shift", torch.zeros(outputs, *sheet))
        self.register_buffer("output_scale", torch.ones(outputs, 1, 1))

    def scaled(self, maps: Tensor) -> Tensor:
        """The maps (B, inputs, H, W) as the network sees them."""
        scaled = (maps - self.input_shift) / self.input_scale
        return scaled.clamp(-self.reach, self.reach) if self.reach else scaled

    def forward(self, maps: Tensor) -> Tensor:
        """Motion (and history) maps (B, inputs, H, W) -> offset maps (B, templates * 3, H, W), m."""
        return self.unet(self.scaled(maps)).float() * self.output_scale + self.output_shift


def mirror(maps: Tensor) -> Tensor:
    """Left-right mirror image of maps of vectors (B, 3 n, H, W): the layout is symmetric about u = 0.5."""
    signs = maps.new_ones(maps.shape[1])
    signs[::3] = -1.0
    return maps.flip(-1) * signs[:, None, None]
