"""Fixed sparse matrices that are applied to batches: their gradient is the transposed matrix, no scatter."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from torch import Tensor

Dense = Callable[[Tensor], Tensor]
"""A linear map of dense columns: (columns, C) -> (rows, C)."""


class _Applied(torch.autograd.Function):
    """A linear map of dense columns; the backward pass applies its transpose and saves no tensor."""

    @staticmethod
    def forward(ctx: Any, dense: Tensor, linear: Dense, transposed: Dense) -> Tensor:
        ctx.transposed = transposed
        return linear(dense)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        return ctx.transposed(gradients[0].contiguous()), None, None


def apply_linear(values: Tensor, linear: Dense, transposed: Dense) -> Tensor:
    """Apply a fixed linear map to every channel of every item: (B, columns, C) -> (B, rows, C)."""
    batch, _, channels = values.shape
    dense = values.transpose(0, 1).flatten(1).contiguous()
    applied: Tensor = _Applied.apply(dense, linear, transposed)  # type: ignore[no-untyped-call]
    return applied.view(-1, batch, channels).transpose(0, 1)


@dataclass(frozen=True)
class Operator:
    """A sparse matrix (rows, columns) and its transpose, both in compressed rows."""

    matrix: Tensor
    transposed: Tensor

    def __call__(self, values: Tensor) -> Tensor:
        """Apply it to every channel of every item: (B, columns, C) -> (B, rows, C)."""
        return apply_linear(values, *(partial(torch.mm, each) for each in (self.matrix, self.transposed)))


def sampling(indices: Tensor, shares: Tensor, columns: int) -> Operator:
    """Weighted sums: row n adds shares (N, S) of the columns indices (N, S)."""
    rows = torch.arange(len(indices), device=indices.device).repeat_interleave(indices.shape[1])
    return _operator(rows, indices.flatten(), shares.flatten(), (len(indices), columns))


def differences(edges: Tensor, columns: int) -> Operator:
    """First end minus second end of every edge (E, 2)."""
    ends = torch.tensor([1.0, -1.0], device=edges.device).expand(len(edges), 2)
    return sampling(edges, ends, columns)


def _operator(rows: Tensor, columns: Tensor, values: Tensor, shape: tuple[int, int]) -> Operator:
    """An operator of entries (row, column, value)."""

    def compressed(first: Tensor, second: Tensor, size: tuple[int, int]) -> Tensor:
        sparse = torch.sparse_coo_tensor(
            torch.stack([first, second]),
            values.float(),
            size,
            device=values.device,
            check_invariants=False,
        )
        return sparse.coalesce().to_sparse_csr()

    return Operator(compressed(rows, columns, shape), compressed(columns, rows, shape[::-1]))
