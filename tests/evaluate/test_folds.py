"""Measures of folds on a flat sheet, where waves and curvature are known."""

import math

import pytest
import torch
from torch import Tensor

from evaluate.folds import (
    FoldFilters,
    band_energies,
    correlation,
    fold_curvature,
    fold_filters,
    fold_looks,
    fold_scores,
)

COUNT, SPACING = 61, 0.004


@pytest.fixture(scope="module")
def filters() -> FoldFilters:
    rest, faces = flat()
    return fold_filters(rest, faces)


def flat() -> tuple[Tensor, Tensor]:
    """A square sheet (N, 3) m, (M, 3)."""
    x, y = torch.meshgrid(torch.arange(COUNT), torch.arange(COUNT), indexing="ij")
    index = torch.arange(COUNT * COUNT).view(COUNT, COUNT)
    a, b, c, d = (each.flatten() for each in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    rest = torch.stack([SPACING * x.flatten(), SPACING * y.flatten(), torch.zeros(COUNT**2)], 1)
    return rest, torch.cat([torch.stack([a, b, c], 1), torch.stack([a, c, d], 1)])


def waves(wavelength: float, phase: float = 0.0) -> Tensor:
    """Waves of 1 mm along x (1, N, 3) m."""
    rest, _ = flat()
    heights = 0.001 * (2.0 * math.pi * rest[:, 0] / wavelength + phase).cos()
    return (heights[:, None] * torch.tensor([0.0, 0.0, 1.0]))[None].double()


def smooth() -> Tensor:
    return flat()[0][None].double()


@pytest.mark.parametrize(("wavelength", "band"), [(0.055, 0), (0.028, 1)])
def test_waves_are_in_the_band_of_their_length(filters: FoldFilters, wavelength: float, band: int) -> None:
    energies = band_energies(filters, waves(wavelength))[0]
    assert int(energies.argmax()) == band
    assert float(energies[band]) == pytest.approx(0.5, rel=0.3)


def test_curvature_of_waves(filters: FoldFilters) -> None:
    wavelength = 0.05
    curvature = fold_curvature(filters, smooth(), waves(wavelength))[0].view(COUNT, COUNT)[10:-10, 10:-10]
    wave = waves(wavelength)[0, :, 2].view(COUNT, COUNT)[10:-10, 10:-10]
    torch.testing.assert_close(curvature, wave * (2.0 * math.pi / wavelength) ** 2, atol=0.4, rtol=0.0)


def test_true_folds_score_fully_and_shifted_ones_do_not(filters: FoldFilters) -> None:
    real = fold_looks(filters, smooth(), waves(0.05))
    same = fold_scores(filters, real, real)
    assert all(float(value) == pytest.approx(1.0, abs=1e-6) for value in same.values())
    quarter = fold_scores(filters, fold_looks(filters, smooth(), waves(0.05, 0.5 * math.pi)), real)
    assert abs(float(quarter["signed"])) < 0.2
    assert float(quarter["cosine"]) < float(same["cosine"])
    opposite = fold_scores(filters, fold_looks(filters, smooth(), waves(0.05, math.pi)), real)
    assert float(opposite["signed"]) == pytest.approx(-1.0, abs=1e-6)
    # Folds that point the other way are at the same places.
    assert float(opposite["places"]) == pytest.approx(1.0, abs=1e-6)


def test_no_folds_correlate_with_nothing(filters: FoldFilters) -> None:
    real = fold_looks(filters, smooth(), waves(0.05))
    none = fold_scores(filters, fold_looks(filters, smooth(), torch.zeros_like(smooth())), real)
    assert float(none["signed"]) == float(none["places"]) == 0.0
    assert float(none["cosine"]) < 1.0


def test_correlation_is_weighted_by_area() -> None:
    one, other = torch.tensor([[0.0, 1.0, 0.0, 1.0]]), torch.tensor([[0.0, 1.0, 1.0, 0.0]])
    first = torch.tensor([1.0, 1.0, 1e-9, 1e-9])
    assert float(correlation(one, other, first)) == pytest.approx(1.0, abs=1e-3)
    assert float(correlation(one, other, torch.ones(4))) == pytest.approx(0.0)
