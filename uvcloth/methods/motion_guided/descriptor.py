"""First convolutions over the positions of a garment relative to 581 seeds, without a channel for each.

The descriptor of a vertex is its position relative to every seed, g - b_j: 1,743 channels. A convolution over
them is exactly one over the position and a mask, whose kernel holds the seeds' positions (Motion-guided,
sections 4.2 and 5).
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

FARTHEST = 4.0
"""Standard deviations beyond which the force of a seed is ignored: it is below 1/2,980 there."""

TAPS = 3
"""Height and width of the kernels."""


class SeedKernel(nn.Module):
    """A kernel (outputs, S, 3, TAPS * TAPS) over one vector per seed."""

    def __init__(self, seeds: int, outputs: int) -> None:
        super().__init__()
        bound = 1.0 / math.sqrt(3 * seeds * TAPS**2)
        self.weight = nn.Parameter(torch.empty(outputs, seeds, 3, TAPS**2).uniform_(-bound, bound))


class RelativePositions(SeedKernel):
    """Convolution of [g - b_j]_j, zero off the garment's charts."""

    def forward(self, positions: Tensor, mask: Tensor, seeds: Tensor) -> Tensor:
        """Positions (B, 3, H, W) m, zero off the charts, mask (1, 1, H, W), seeds (B, S, 3): (B, C, H, W)."""
        kernel = self.weight.sum(1).unflatten(-1, (TAPS, TAPS))
        response = functional.conv2d(positions, kernel, padding=TAPS // 2)
        shift = torch.einsum("osat,bsa->bot", self.weight, seeds)
        patches = functional.unfold(mask, TAPS, padding=TAPS // 2)
        return response - (shift @ patches).view_as(response)


@dataclass(frozen=True)
class Forces:
    """Forces of S seeds on P texels, (B, P, S) m, of which few are not zero: all others are left out.

    pairs: (K,) int64 ascending, places in the flattened shape. values: (K,) m.
    """

    pairs: Tensor
    values: Tensor
    shape: torch.Size

    def dense(self) -> Tensor:
        """The forces of all pairs (B, P, S), m."""
        return (
            self.values.new_zeros(self.shape.numel()).index_copy(0, self.pairs, self.values).view(self.shape)
        )


class SeedForces(SeedKernel):
    """Convolution of [f_j n_j]_j, zero off the garment's charts."""

    def forward(self, forces: Forces, normals: Tensor, pixels: Tensor, size: int) -> Tensor:
        """Forces (B, P, S) on the texels at pixels (P,); normals (B, S, 3) -> (B, C, size, size)."""
        batch, texels, seeds = forces.shape
        # A tap reads its neighbour: seen from that texel, it writes to the other side.
        axes = zip(self.weight.unbind(2), normals.unbind(2), strict=True)
        x, y, z = (kernel * along[:, None, :, None] for kernel, along in axes)
        taps = (x + y + z).flip(-1)
        # Laid out channels last, they are not in one piece yet, which costs the sums most of their speed.
        rows = taps.transpose(1, 2).reshape(batch * seeds, -1).contiguous()
        pairs, first = forces.pairs, torch.arange(0, forces.shape.numel(), seeds, device=pixels.device)
        written = functional.embedding_bag(
            pairs % seeds + pairs // (texels * seeds) * seeds,
            rows,
            torch.searchsorted(pairs, first),
            per_sample_weights=forces.values.to(rows),
            mode="sum",
        )
        maps = written.new_zeros(batch, size * size, written.shape[1])
        maps = maps.index_copy(1, pixels, written.view(batch, texels, -1)).transpose(1, 2)
        return functional.fold(maps, (size, size), TAPS, padding=TAPS // 2)


def contact_forces(
    before: Tensor, seeds_before: Tensor, seeds: Tensor, normals: Tensor, sigma: float
) -> Forces:
    """Depth of the previous garment behind the planes of seeds, less of far ones (section 5): (B, P, S).

    before: (B, P, 3) m, points of the previous garment. seeds_before, seeds, normals: (B, S, 3).
    """
    # Both are products of the points with a row per seed, the constants with a one.
    points = torch.cat([before, torch.ones_like(before[..., :1])], dim=-1)
    depth = points @ torch.cat([-normals, (seeds * normals).sum(-1, keepdim=True)], dim=-1).mT
    seed_rows = torch.cat([-2.0 * seeds_before, seeds_before.square().sum(-1, keepdim=True)], dim=-1)
    apart = torch.baddbmm(before.square().sum(-1, keepdim=True), points, seed_rows.mT)
    behind = (depth > 0.0) & (apart < (FARTHEST * sigma) ** 2)
    pairs = torch.nonzero(behind.flatten()).squeeze(1)
    near, deep = (values.flatten().index_select(0, pairs) for values in (apart, depth))
    return Forces(pairs, torch.exp(near.clamp(min=0.0) / (-2.0 * sigma**2)) * deep, depth.shape)
