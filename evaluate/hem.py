"""Hems: saw teeth along them, and the energy of their motion."""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.geometry.mesh import boundary_edges, weld

from .metrics import MM, Reference


@dataclass(frozen=True)
class Hem:
    """The vertices along the hems of a garment: (H,) int64 each, before, at and after each one."""

    before: Tensor
    here: Tensor
    after: Tensor


def find_hem(rest: Tensor, faces: Tensor) -> Hem:
    """The hems of a mesh at rest (N, 3) with faces (M, 3), seams welded, without vertices where two meet."""
    edges = boundary_edges(weld(rest)[faces])
    ends = [torch.bincount(edges[:, end], minlength=len(rest)) == 1 for end in (0, 1)]
    here = torch.nonzero(ends[0] & ends[1]).squeeze(1)
    after, before = torch.zeros(len(rest), dtype=torch.long), torch.zeros(len(rest), dtype=torch.long)
    after[edges[:, 0]], before[edges[:, 1]] = edges[:, 1], edges[:, 0]
    return Hem(before[here], here, after[here])


def hem_scores(hem: Hem, vertices: Tensor, reference: Reference) -> dict[str, Tensor]:
    """Roughness (F,) and motion (F - 1,) of the hems of (F, N, 3); nothing without any.

    hem_roughness_mm: mean distance of a hem's vertices from the middle of both neighbours along it.
    hem_square: mean squared step between frames relative to the skinned garment, mm2.
    """
    if not len(hem.here):
        return {}
    middle = 0.5 * (vertices[:, hem.before] + vertices[:, hem.after])
    steps = (vertices - reference.skinned)[:, hem.here].diff(dim=0) * MM
    return {
        "hem_roughness_mm": (vertices[:, hem.here] - middle).norm(dim=2).mean(1) * MM,
        "hem_square": steps.square().sum(2).mean(1),
    }
