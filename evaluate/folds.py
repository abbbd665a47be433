"""Folds: how those of a garment compare with the true ones on the same smooth surface.

Everything is measured on the refined mesh of the garment, as displacements from the smooth surface: their
size in bands of wavelength, where they are, the normals that they give, and how they change.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from uvcloth.geometry.mesh import vertex_normals

from .surface import GarmentSurface, make_surface

WAVELENGTHS = (0.08, 0.04, 0.02, 0.01)
"""Limits between the bands, metres, from the longest waves to the shortest."""

BLURS = (0.02, 0.04)
"""Standard deviations, m, of the blur of signed curvature, and of its size: about a wavelength of a fold."""


@dataclass(frozen=True)
class FoldFilters:
    """Filters on a garment's surface. passes: low-pass, at WAVELENGTHS. blurs: averages of BLURS."""

    surface: GarmentSurface
    passes: tuple[Callable[[Tensor], Tensor], ...]
    blurs: tuple[Callable[[Tensor], Tensor], ...]


def fold_filters(rest: Tensor, faces: Tensor) -> FoldFilters:
    """Prepare the filters of a welded mesh at rest (n, 3) m, (m, 3)."""
    surface = make_surface(rest, faces)
    passes = tuple(surface.low_pass(wavelength) for wavelength in WAVELENGTHS)
    return FoldFilters(surface, passes, tuple(surface.diffusion(width) for width in BLURS))


def band_energies(filters: FoldFilters, displacements: Tensor) -> Tensor:
    """Mean squares of displacements (F, n, 3) m in each band: (F, len(WAVELENGTHS) - 1), mm2.

    The first band is of the waves between the first two limits.
    """
    areas = torch.from_numpy(filters.surface.areas)
    values = 1000.0 * displacements.double()
    longer = [((values * each(values)).sum(2) @ areas) for each in filters.passes]
    return torch.stack([(more - less).clamp(min=0.0) for less, more in pairwise(longer)], 1) / areas.sum()


def fold_curvature(filters: FoldFilters, smooth: Tensor, displacements: Tensor) -> Tensor:
    """Curvature (F, n) 1/m that displacements (F, n, 3) m add to smooth surfaces (F, n, 3) m.

    It is the cotangent Laplacian of the displacement along the smooth surface's normal.
    """
    normals = vertex_normals(smooth, filters.surface.mesh.faces)
    laplacian, areas = filters.surface.laplacian, filters.surface.areas
    columns = displacements.double().transpose(0, 1).flatten(1).numpy()
    curved = torch.from_numpy((laplacian @ columns) / areas[:, None])
    curved = curved.unflatten(1, (len(smooth), -1)).transpose(0, 1)
    return (curved * normals.double()).sum(2)


def correlation(one: Tensor, other: Tensor, areas: Tensor) -> Tensor:
    """Correlation (F,) of fields (F, n), weighted by areas (n,); 0 where one of them is constant."""
    weights = areas / areas.sum()
    a, b = (field - (field @ weights)[:, None] for field in (one, other))
    product = (a * b) @ weights
    scale = ((a.square() @ weights) * (b.square() @ weights)).sqrt()
    return torch.where(scale > 0.0, product / scale.clamp(min=1e-300), 0.0)


@dataclass(frozen=True)
class FoldLooks:
    """Looks of F frames of folds on a mesh of n vertices.

    energies: (F, bands) mm2, see `band_energies`. normals: (F, n, 3) of the surface with its folds. signed:
    (F, n) 1/m, curvature of the folds, blurred by the first of BLURS. sizes: (F, n) 1/m, its size, blurred by
    the second.
    """

    energies: Tensor
    normals: Tensor
    signed: Tensor
    sizes: Tensor


def fold_looks(filters: FoldFilters, smooth: Tensor, displacements: Tensor) -> FoldLooks:
    """The looks of displacements (F, n, 3) m from smooth surfaces (F, n, 3) m."""
    curvature = fold_curvature(filters, smooth, displacements)[..., None]
    fine, wide = filters.blurs
    return FoldLooks(
        band_energies(filters, displacements),
        vertex_normals((smooth + displacements).float(), filters.surface.mesh.faces).double(),
        fine(curvature)[..., 0],
        wide(curvature.abs())[..., 0],
    )


def fold_scores(filters: FoldFilters, made: FoldLooks, real: FoldLooks) -> dict[str, Tensor]:
    """Scores (F,) of folds against the real ones.

    cosine: of normals. signed, places: correlations of signed curvature, and of where it is large.
    """
    areas = torch.from_numpy(filters.surface.areas)
    return {
        "cosine": (made.normals * real.normals).sum(2) @ (areas / areas.sum()),
        "signed": correlation(made.signed, real.signed, areas),
        "places": correlation(made.sizes, real.sizes, areas),
    }
