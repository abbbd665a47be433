"""Blend shapes for a file, and their weights within the [0, 1] that every engine plays.

A pose embedding X (W,) deforms by X D, with D the network's blend shapes. Engines clamp weights to [0, 1], so
each shape is scaled by the range lo .. hi that its weight has over known poses, and lo of it goes into the
base: base += lo D, D *= hi - lo, w = (w - lo) / (hi - lo). Within that range nothing changes.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.errors import InputError

LEAST_MOVE = 1e-6
"""Metres: a shape that moves no vertex by more over the known poses is left out."""

LEAST_SPREAD = 1e-5
"""Share of the strongest direction's spread below which a direction is rounding error."""

POSES_AT_ONCE = 256
"""Poses whose deformations are in memory at once."""


@dataclass(frozen=True)
class ShapeCode:
    """Code between pose embeddings and K weights: X D ~ (constant + weights @ mix) D.

    scale: (W, K) and shift: (K,) make weights of embeddings (B, W). constant: (W,). mix: (K, W).
    """

    scale: Tensor
    shift: Tensor
    constant: Tensor
    mix: Tensor

    def __len__(self) -> int:
        return len(self.mix)

    def weights(self, embeddings: Tensor) -> Tensor:
        """Weights in [0, 1] of embeddings (B, W): (B, K); values outside the known range are clamped."""
        return (embeddings @ self.scale + self.shift).clamp(0.0, 1.0)

    def restored(self, weights: Tensor) -> Tensor:
        """Embeddings (B, W) of weights (B, K)."""
        return self.constant + weights @ self.mix


def own_shapes(shapes: Tensor, known: Tensor) -> ShapeCode:
    """Code of the network's own blend shapes (W, V, 3) that move a vertex over known embeddings (M, W)."""
    if not len(shapes):
        none = known.new_zeros(0)
        return ShapeCode(known.new_zeros(0, 0), none, none, known.new_zeros(0, 0))
    low, high = known.amin(0), known.amax(0)
    moves = (high - low) * shapes.norm(dim=-1).amax(1) > LEAST_MOVE
    columns = torch.eye(len(moves), dtype=known.dtype)[:, moves]
    still = torch.where(moves, 0.0, 0.5 * (low + high))
    return _ranged(known, still, columns, columns.T)


def principal_shapes(shapes: Tensor, training: Tensor, known: Tensor, count: int) -> ShapeCode:
    """Code of the `count` shapes that best explain the training poses' deformations (principal components).

    shapes: (W, V, 3). training: (M, W) embeddings. known: (B, W) embeddings that have to stay in range.
    Raises InputError if the training poses' deformations have fewer directions.
    """
    # Singular vectors of (X - mean) D, found in the W dimensions of X: D is L times orthonormal rows.
    flat = shapes.flatten(1).double()
    sizes, axes = torch.linalg.eigh(flat @ flat.T)
    kept = sizes > LEAST_SPREAD**2 * sizes[-1]
    lengths = sizes[kept].sqrt()
    mean = training.double().mean(0)
    spread = (training.double() - mean) @ (axes[:, kept] * lengths)
    variance, directions = torch.linalg.eigh(spread.T @ spread)
    there = int((variance > LEAST_SPREAD**2 * variance[-1].clamp(min=1e-30)).sum())
    if count > there:
        raise InputError(f"--shapes {count}: the training poses need no more than {there} blend shapes")
    directions = directions.flip(1)[:, :count]
    encode = (axes[:, kept] * lengths) @ directions
    decode = directions.T @ (axes[:, kept] / lengths).T
    return _ranged(known.double(), mean, encode, decode, shapes.dtype)


def _ranged(
    known: Tensor, centre: Tensor, encode: Tensor, decode: Tensor, dtype: torch.dtype = torch.float32
) -> ShapeCode:
    """Code with weights (X - centre) @ encode, shifted into [0, 1]; X ~ centre + weights @ decode."""
    coordinates = (known - centre) @ encode
    low, high = coordinates.amin(0), coordinates.amax(0)
    extent = high - low
    parts = (
        encode / extent,
        -(centre @ encode + low) / extent,
        centre + low @ decode,
        decode * extent[:, None],
    )
    return ShapeCode(*(part.to(dtype) for part in parts))


@dataclass(frozen=True)
class Cost:
    """Displacement by a simplification: mean and maximum over vertices and poses, m; over: the poses."""

    mean: float
    most: float
    over: str


def cost(apart: Iterable[Tensor], over: str) -> Cost:
    """Cost from distances, m, that come in batches of whole poses (B, V)."""
    sums = [(float(part.mean(1).sum()), float(part.max()), len(part)) for part in apart]
    means, mosts, counts = zip(*sums, strict=True)
    return Cost(sum(means) / sum(counts), max(mosts), over)


def shape_cost(code: ShapeCode, shapes: Tensor, embeddings: Tensor, over: str) -> Cost:
    """Cost of a code: its deformations against the network's own, shapes (W, V, 3) m, at rest."""
    lost, flat = embeddings - code.restored(code.weights(embeddings)), shapes.flatten(1)
    return cost(
        ((rows @ flat).view(len(rows), -1, 3).norm(dim=-1) for rows in lost.split(POSES_AT_ONCE)), over
    )
