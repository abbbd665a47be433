"""First convolutions over what 581 seeds see of a garment, without a channel for each of them.

The descriptor of a vertex is its position relative to every seed, g - b_j: 1,743 channels. A convolution over
them is exactly one over the position and a mask, whose kernel holds the seeds' positions (Motion-guided,
sections 4.2 and 5).
"""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

FARTHEST = 4.0
"""Standard deviations from which on a seed pushes nothing: less than a 2,980th."""

TAPS = 3
"""Height and width of the kernels."""


class SeedKernel(nn.Module):
    """A kernel (outputs, S, 3, TAPS * TAPS) over one vector per seed."""

    def __init__(self, seeds: int, outputs: int) -> None:
        super().__init__()
        bound = 1.0 / math.sqrt(3 * seeds * TAPS**2)
        self.weight = nn.Parameter(torch.empty(outputs, seeds, 3, TAPS**2).uniform_(-bound, bound))


class RelativePositions(SeedKernel):
    """Convolves [g - b_j]_j, zero off the garment's charts."""

    def forward(self, positions: Tensor, mask: Tensor, seeds: Tensor) -> Tensor:
        """Positions (B, 3, H, W) m, zero off the charts, mask (1, 1, H, W), seeds (B, S, 3): (B, C, H, W)."""
        kernel = self.weight.sum(1).unflatten(-1, (TAPS, TAPS))
        seen = functional.conv2d(positions, kernel, padding=TAPS // 2)
        shift = torch.einsum("osat,bsa->bot", self.weight, seeds)
        patches = functional.unfold(mask, TAPS, padding=TAPS // 2)
        return seen - (shift @ patches).view_as(seen)


class SeedForces(SeedKernel):
    """Convolves [f_j n_j]_j, zero off the garment's charts."""

    def forward(self, forces: Tensor, normals: Tensor, pixels: Tensor, size: int) -> Tensor:
        """Forces (B, P, S) on the texels at pixels (P,); normals (B, S, 3) -> (B, C, size, size)."""
        batch, outputs = len(forces), len(self.weight)
        pushed = torch.nonzero(forces.detach().amax((0, 2))).squeeze(1)
        forces, pixels = forces[:, pushed], pixels[pushed]
        # A tap reads its neighbour: seen from that texel, it writes to the other side.
        taps = torch.einsum("osat,bsa->bsot", self.weight.flip(-1), normals).flatten(2)
        written = forces.new_zeros(batch, outputs * TAPS**2, size * size)
        written = written.index_copy(2, pixels, (forces @ taps).transpose(1, 2))
        return functional.fold(written, (size, size), TAPS, padding=TAPS // 2)


def contact_forces(
    before: Tensor, seeds_before: Tensor, seeds: Tensor, normals: Tensor, sigma: float
) -> Tensor:
    """Depth of the previous garment behind the planes of seeds, less of far ones (section 5): (B, P, S).

    before: (B, P, 3) m, points of the previous garment. seeds_before, seeds, normals: (B, S, 3).
    """
    depth = (seeds * normals).sum(-1)[:, None] - before @ normals.transpose(1, 2)
    apart = torch.baddbmm(seeds_before.square().sum(-1)[:, None], before, seeds_before.mT, alpha=-2.0)
    apart += before.square().sum(-1, keepdim=True)
    behind = (depth > 0.0) & (apart < (FARTHEST * sigma) ** 2)
    pushes = torch.exp(-apart[behind].clamp(min=0.0) / (2.0 * sigma**2)) * depth[behind]
    return torch.zeros_like(depth).masked_scatter_(behind, pushes)
