"""The first convolution of Motion-guided over 581 seeds, beside its plain twin of 1,743 channels, in one run.

PYTHONPATH=. python benchmarks/descriptor.py [--size 128] [--width 128]
"""

from dataclasses import dataclass

import torch
import tyro
from torch import Tensor
from torch.nn import functional

from benchmarks.timing import fastest
from uvcloth.methods.motion_guided.descriptor import TAPS, RelativePositions


@dataclass(frozen=True)
class Options:
    """Compare the two, forward alone and with the gradient of the kernel."""

    size: int = 128
    """Height and width of the maps."""
    width: int = 128
    """Channels that come out."""
    seeds: int = 581
    """Seed points."""
    rounds: int = 3
    """Measurements of each; the fastest counts."""


def plain(layer: RelativePositions, positions: Tensor, mask: Tensor, seeds: Tensor) -> Tensor:
    """A channel per seed and axis, as published."""
    channels = (positions[:, None] - seeds[..., None, None]) * mask[:, :, None]
    kernel = layer.weight.flatten(1, 2).unflatten(-1, (TAPS, TAPS))
    return functional.conv2d(channels.flatten(1, 2), kernel, padding=TAPS // 2)


def main() -> None:
    options = tyro.cli(Options)
    layer = RelativePositions(options.seeds, options.width)
    mask = (torch.rand(1, 1, options.size, options.size) > 0.4).float()
    given = (torch.randn(1, 3, options.size, options.size) * mask, mask, torch.randn(1, options.seeds, 3))
    apart = float((plain(layer, *given) - layer(*given)).detach().abs().max())
    print(f"largest difference {apart:.1e}")
    with torch.no_grad():
        ours = 1e3 * fastest(lambda: layer(*given), options.rounds)
        theirs = 1e3 * fastest(lambda: plain(layer, *given), options.rounds)
    print(f"forward: ours {ours:.1f} ms, plain {theirs:.1f} ms, ratio {theirs / ours:.1f}")
    ours = 1e3 * fastest(lambda: layer(*given).sum().backward(), options.rounds)
    theirs = 1e3 * fastest(lambda: plain(layer, *given).sum().backward(), options.rounds)
    print(f"with gradient: ours {ours:.1f} ms, plain {theirs:.1f} ms, ratio {theirs / ours:.1f}")


if __name__ == "__main__":
    main()
