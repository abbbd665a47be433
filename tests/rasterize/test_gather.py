"""The weighted row gather: both of its ways, with and without gradients, against a dense matrix."""

import pytest
import torch

from rasterize.gather import gather


def dense(values: torch.Tensor, indices: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    """The same sums as a product with the matrix that has the weights in its rows."""
    shape = (*weights.shape[:-1], values.shape[-2])
    matrix = values.new_zeros(shape).scatter_add(-1, indices.expand(weights.shape), weights)
    return matrix @ values


@pytest.mark.parametrize("leading", [(), (2,), (2, 3)])
@pytest.mark.parametrize("each", [False, True])
@pytest.mark.parametrize("gradient", [False, True])
def test_sums_are_those_of_a_matrix(leading: tuple[int, ...], each: bool, gradient: bool) -> None:
    values = torch.randn(*leading, 7, 4, dtype=torch.float64, requires_grad=gradient)
    indices = torch.randint(0, 7, (5, 3))
    weights = torch.rand(*(leading if each else ()), 5, 3, dtype=torch.float64)
    torch.testing.assert_close(gather(values, indices, weights), dense(values, indices, weights))


def test_gradients_for_values_and_for_weights() -> None:
    values = torch.randn(2, 6, 3, dtype=torch.float64, requires_grad=True)
    weights = torch.rand(2, 4, 5, dtype=torch.float64, requires_grad=True)
    indices = torch.randint(0, 6, (4, 5))
    assert torch.autograd.gradcheck(gather, (values, indices, weights))
    assert torch.autograd.gradcheck(gather, (values, indices, weights.detach()))
    assert torch.autograd.gradcheck(gather, (values.detach(), indices, weights))


def test_result_has_the_dtype_of_the_values_and_no_rows_give_none() -> None:
    values, weights = torch.randn(2, 6, 3, dtype=torch.float64), torch.rand(4, 2)
    assert gather(values, torch.zeros(4, 2, dtype=torch.int64), weights).dtype == torch.float64
    assert gather(values, torch.zeros(0, 2, dtype=torch.int64), weights[:0]).shape == (2, 0, 3)
