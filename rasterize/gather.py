"""Weighted sums of rows: how values at vertices become values at texels, and back."""

import torch
from torch import Tensor


def gather(values: Tensor, indices: Tensor, shares: Tensor) -> Tensor:
    """Weighted sums of rows: values (..., V, C), indices and shares (P, K) -> (..., P, C)."""
    total = values.index_select(-2, indices[:, 0]) * shares[:, :1]
    for column in range(1, indices.shape[1]):
        total = total + values.index_select(-2, indices[:, column]) * shares[:, column : column + 1]
    return total


def weighted_rows(values: Tensor, indices: Tensor, shares: Tensor) -> Tensor:
    """Weighted sums of rows: values (B, V, C), indices (N, K), shares (N, K) or (B, N, K) -> (B, N, C).

    One pass for many rows each, where `gather` makes one per column; gradients for the shares are fast.
    """
    batch, rows, channels = values.shape
    first = rows * torch.arange(batch, device=values.device)[:, None, None]
    picked = torch.nn.functional.embedding_bag(
        (indices + first).flatten(0, 1),
        values.reshape(-1, channels),
        per_sample_weights=shares.expand(batch, *indices.shape).flatten(0, 1),
        mode="sum",
    )
    return picked.view(batch, len(indices), channels)
