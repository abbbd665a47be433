"""Sparse factors in the runtime: columns are solved as dense algebra solves them."""

import numpy as np
import pytest

from uvcloth.player.sparse_factors import SparseFactors

SIZE = 37


@pytest.mark.parametrize("columns", [1, 8, 19])
@pytest.mark.parametrize("kind", [float, complex])
def test_columns_are_solved(kind: type, columns: int) -> None:
    draw = np.random.default_rng(columns)

    def drawn(*shape: int) -> np.ndarray:
        real = draw.normal(size=shape)
        return real + 1j * draw.normal(size=shape) if kind is complex else real

    below = np.tril(drawn(SIZE, SIZE) * (draw.random((SIZE, SIZE)) < 0.2), -1)
    pivots, right = 2.0 + drawn(SIZE), drawn(SIZE, columns)
    rows = [np.nonzero(below[:, k])[0] for k in range(SIZE)]
    starts = np.cumsum([0, *map(len, rows)])
    values = np.concatenate([below[row, k] for k, row in enumerate(rows)])
    lower = below + np.eye(SIZE)
    before = right.copy()
    solved = SparseFactors(starts, np.concatenate(rows), values, pivots).solve(right)
    assert np.array_equal(right, before)
    assert np.allclose(lower @ np.diag(pivots) @ lower.T @ solved, right, rtol=0, atol=1e-9)
