"""Fixed sparse matrices against the matrices written out, forwards and backwards."""

import torch

from uvcloth.geometry.operators import Operator, differences, sampling

VALUES = torch.tensor([[[1.0, 10.0], [2.0, 20.0], [4.0, 40.0]], [[0.0, 1.0], [3.0, 0.0], [5.0, 2.0]]])
"""(B, columns, C) = (2, 3, 2)."""


def backwards(operator: Operator, rows: int) -> tuple[torch.Tensor, torch.Tensor]:
    """A slope for every row of the result, and that of the values that follows: (2, rows, 2), (2, 3, 2)."""
    values = VALUES.clone().requires_grad_()
    slope = torch.arange(1.0, 1.0 + 4 * rows).view(2, rows, 2)
    (found,) = torch.autograd.grad(operator(values), values, slope)
    return slope, found


def test_sampling_adds_shares_of_rows_and_shares_out_gradients() -> None:
    operator = sampling(torch.tensor([[0, 2], [1, 1]]), torch.tensor([[0.25, 0.75], [0.5, 0.25]]), 3)
    matrix = torch.tensor([[0.25, 0.0, 0.75], [0.0, 0.75, 0.0]])
    expected = [[[3.25, 32.5], [1.5, 15.0]], [[3.75, 1.75], [2.25, 0.0]]]
    torch.testing.assert_close(operator(VALUES), torch.tensor(expected))
    slope, found = backwards(operator, 2)
    torch.testing.assert_close(found, matrix.T @ slope)


def test_differences_are_first_ends_less_second_ends() -> None:
    operator = differences(torch.tensor([[0, 1], [2, 0], [1, 2]]), 3)
    expected = [[[-1.0, -10.0], [3.0, 30.0], [-2.0, -20.0]], [[-3.0, 1.0], [5.0, 1.0], [-2.0, -2.0]]]
    torch.testing.assert_close(operator(VALUES), torch.tensor(expected))
    matrix = torch.tensor([[1.0, -1.0, 0.0], [-1.0, 0.0, 1.0], [0.0, 1.0, -1.0]])
    slope, found = backwards(operator, 3)
    torch.testing.assert_close(found, matrix.T @ slope)


def test_operators_are_made_on_the_device_of_their_entries() -> None:
    """As on a GPU: the entries are on another device than new tensors are by default."""
    entries, shares = torch.tensor([[0, 2], [1, 1]]), torch.ones(2, 2)
    with torch.device("meta"):
        made = (sampling(entries, shares, 3), differences(entries, 3))
    assert all(operator.matrix.device == entries.device for operator in made)
    torch.testing.assert_close(made[1](VALUES), differences(entries, 3)(VALUES))
