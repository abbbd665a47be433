"""Diffusion over meshes as sums of Chebyshev polynomials: n passes need about sqrt(n) products."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import chebinterpolate
from torch import Tensor

NEGLIGIBLE = 1e-7
"""Share of a vertex's diffused values that is left out."""


def averaging_shares(passes: int) -> list[float]:
    """Shares of the Chebyshev polynomials of x in ((1 + x) / 2)^passes, the lazy average over neighbours."""
    return _shares(lambda x: ((1.0 + x) / 2.0) ** passes, passes, passes)


def heat_shares(rate: float) -> list[float]:
    """Shares of the Chebyshev polynomials of x in exp(rate (x - 1)), the heat kernel after a time `rate`."""
    return _shares(lambda x: np.exp(rate * (x - 1.0)), rate, None)


def chebyshev_sum(average: Callable[[Tensor], Tensor], values: Tensor, shares: Sequence[float]) -> Tensor:
    """Sum of the Chebyshev polynomials of a linear map, each times its share, of values of any shape.

    average: the map, whose eigenvalues lie within -1 to 1, into a new tensor. shares: at least two.
    """
    before, now = values, average(values)
    total = (shares[0] * before).add_(now, alpha=shares[1])
    for share in shares[2:]:
        before, now = now, average(now).mul_(2.0).sub_(before)
        total.add_(now, alpha=share)
    return total


def _shares(function: Callable[[Any], Any], rate: float, most: int | None) -> list[float]:
    """Shares of a function whose polynomials fade within a few times the root of a rate, at least two."""
    degree = math.ceil(16.0 + 8.0 * math.sqrt(rate))
    shares = chebinterpolate(function, degree if most is None else min(degree, max(most, 1)))
    last = np.flatnonzero(np.abs(shares) >= NEGLIGIBLE).max(initial=1)
    return [float(share) for share in shares[: last + 1]]
