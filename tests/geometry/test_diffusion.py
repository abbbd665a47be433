"""Sums of Chebyshev polynomials against the powers and exponentials that they stand for."""

import numpy as np
import pytest
import torch
from scipy.linalg import expm
from scipy.special import ive

from uvcloth.geometry.diffusion import averaging_shares, chebyshev_sum, heat_shares

RING = 0.5 * (torch.eye(12).roll(1, 0) + torch.eye(12).roll(-1, 0)).double()
"""Mean over the two neighbours in a ring of twelve: eigenvalues from -1 to 1."""


@pytest.mark.parametrize("rate", [0.0, 0.3, 4.0, 250.0])
def test_heat_shares_are_bessel_functions_and_their_sum_the_exponential(rate: float) -> None:
    shares = heat_shares(rate)
    orders = np.arange(len(shares))
    np.testing.assert_allclose(shares, (2.0 - (orders == 0)) * ive(orders, rate), atol=1e-12)
    assert 2.0 * ive(len(shares), rate) < 1e-6
    kernel = chebyshev_sum(lambda values: RING @ values, torch.eye(12).double(), shares)
    np.testing.assert_allclose(kernel, expm(rate * (RING.numpy() - np.eye(12))), atol=1e-6)


@pytest.mark.parametrize("passes", [1, 2, 5, 40])
def test_averaging_shares_are_passes_of_the_lazy_average(passes: int) -> None:
    expected = np.linalg.matrix_power(0.5 * (np.eye(12) + RING.numpy()), passes)
    found = chebyshev_sum(lambda values: RING @ values, torch.eye(12).double(), averaging_shares(passes))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_fine_mesh_takes_the_root_of_as_many_products() -> None:
    assert len(averaging_shares(10_000)) < 400
    assert len(heat_shares(10_000.0)) < 600
