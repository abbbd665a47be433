"""Boundaries of a garment: neckline, hem and cuffs, each with the plane and the size of its opening."""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.geometry.mesh import boundary_edges, edge_groups, weld

LEAST_RADIUS = 0.12
"""Least radius of an opening, over that of the largest: buttonholes hold no part of the body."""

MOST_UNEVEN = 0.4
"""Greatest standard deviation from its plane, over its radius: an open front is no opening for a limb."""

MOST = 8
"""Openings that are kept, the largest first."""


@dataclass(frozen=True)
class Boundaries:
    """L openings: centres (L, 3), unit normals of their planes, axes (L, 3), and mean radii (L,)."""

    centres: Tensor
    axes: Tensor
    radii: Tensor


def boundaries(vertices: Tensor, faces: Tensor) -> Boundaries:
    """Openings of a mesh (N, 3), (F, 3); vertices at one place are one."""
    edges = boundary_edges(weld(vertices)[faces])
    used, loop = torch.unique(edge_groups(edges, len(vertices)), return_inverse=True)
    middles = (vertices[edges[:, 0]] + vertices[edges[:, 1]]) / 2
    lengths = (vertices[edges[:, 0]] - vertices[edges[:, 1]]).norm(dim=1)
    total = _summed(lengths, loop, len(used)).clamp(min=1e-12)
    centres = _summed(lengths[:, None] * middles, loop, len(used)) / total[:, None]
    away = middles - centres[loop]
    radii = _summed(lengths * away.norm(dim=1), loop, len(used)) / total
    spread = _summed(lengths[:, None, None] * away[:, :, None] * away[:, None, :], loop, len(used))
    variances, directions = torch.linalg.eigh(spread / total[:, None, None])
    uneven = variances[:, 0].clamp(min=0.0).sqrt() / radii.clamp(min=1e-12)
    radii = torch.where(uneven < MOST_UNEVEN, radii, 0.0)
    kept = radii.argsort(descending=True)[:MOST]
    kept = kept[radii[kept] > LEAST_RADIUS * radii[kept[:1]]]
    return Boundaries(centres[kept], directions[kept, :, 0], radii[kept])


def _summed(values: Tensor, group: Tensor, groups: int) -> Tensor:
    return torch.zeros(groups, *values.shape[1:]).to(values).index_add(0, group, values)
