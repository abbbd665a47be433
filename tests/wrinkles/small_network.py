"""A small network with made-up weights, whose wrinkles are of millimetres."""

import torch

from uvcloth.wrinkles.model import Wrinkles
from uvcloth.wrinkles.network import TexelGain, WrinkleConfig, WrinkleNet

CONFIG = WrinkleConfig(size=64, width=4, levels=2)


def made_up_wrinkles(config: WrinkleConfig = CONFIG) -> Wrinkles:
    """A network in which nothing is as before training: last layer, gains and offsets of texels, and mean."""
    torch.manual_seed(0)
    net = WrinkleNet(config)
    torch.nn.init.normal_(net.last.weight, std=1.0)
    torch.nn.init.normal_(net.mean, std=0.1)
    for part in net.modules():
        if isinstance(part, TexelGain):
            torch.nn.init.normal_(part.gain, mean=1.0, std=0.2)
            torch.nn.init.normal_(part.offset, std=0.2)
    net.input_shift.normal_(std=0.1)
    net.input_scale.uniform_(0.5, 2.0)
    return Wrinkles(config, net.eval())
