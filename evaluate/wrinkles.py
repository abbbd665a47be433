"""Wrinkles: the size of the offsets from the skinned garment in bands of wavelength on its surface.

Offsets separate methods where curvature does not: that of a smooth garment on a body is already most of it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from .metrics import MM, Reference, sampled_frames
from .surface import GarmentSurface

WAVELENGTHS = (0.2, 0.1, 0.05)
"""Limits between the bands, metres, from the longest waves to the shortest."""

WRINKLED_FRAMES = 10
"""Most frames of a window that are filtered, evenly spaced: wrinkles change slowly, and a filter is slow."""


@dataclass(frozen=True)
class WaveFilters:
    """The bands on a garment's surface. passes: low-pass filters at WAVELENGTHS."""

    surface: GarmentSurface
    passes: tuple[Callable[[Tensor], Tensor], ...]


def wave_filters(surface: GarmentSurface) -> WaveFilters:
    """Prepare the filters of a surface."""
    return WaveFilters(surface, tuple(surface.low_pass(wavelength) for wavelength in WAVELENGTHS))


def wrinkle_scores(filters: WaveFilters, vertices: Tensor, reference: Reference) -> dict[str, Tensor]:
    """Mean squared offset of (F, N, 3) from the skinned garment in each band of wavelength, mm2: (S, B).

    wrinkle_mm2: per frame of at most WRINKLED_FRAMES. The bands, from the longest waves on, sum to the whole.
    """
    shown = sampled_frames(len(vertices), WRINKLED_FRAMES)
    areas = torch.from_numpy(filters.surface.areas)
    offsets = ((vertices[shown] - reference.skinned[shown]) * MM)[:, filters.surface.mesh.kept].double()
    longer = [
        torch.zeros(len(shown)).double(),
        *((offsets * each(offsets)).sum(2) @ areas for each in filters.passes),
        offsets.square().sum(2) @ areas,
    ]
    bands = [(more - less) / areas.sum() for less, more in pairwise(longer)]
    return {"wrinkle_mm2": torch.stack(bands, dim=1).clamp(min=0.0)}
