"""Garments that never meet, because others lie between them."""

from collections.abc import Sequence

import torch
from torch import Tensor

from uvcloth.physics.layers import Layer

LOOKED = 0.1
"""Metres within which a garment at rest is looked for beneath or over another."""


def kept_apart(garments: Sequence[tuple[Tensor, Tensor]]) -> Tensor:
    """Pairs of G garments at rest between which a third one lies wherever one covers the other: (G, G) bool.

    garments: vertices (N, 3) m and faces (M, 3) of each, the innermost first. So ten layers cost nine times
    as much contact as two, and not 45 times.
    """
    count = len(garments)
    apart = torch.zeros(count, count, dtype=torch.bool)
    if count < 3:
        return apart
    layers = [Layer(vertices, faces) for vertices, faces in garments]
    distances = [_distances(vertices, layers) for vertices, _ in garments]
    for inner in range(count - 2):
        for outer in range(inner + 2, count):
            between = slice(inner + 1, outer)
            is_apart = all(
                _hidden(distances[here][there], distances[here][between])
                for here, there in ((inner, outer), (outer, inner))
            )
            apart[inner, outer] = apart[outer, inner] = is_apart
    return apart


def _distances(points: Tensor, layers: Sequence[Layer]) -> Tensor:
    """Distance (G, N) m of points (N, 3) m from each layer that covers them, or that they cover."""
    nearby = [layer.beside(points, LOOKED) for layer in layers]
    return torch.stack([each.distance.abs().where(each.covered, torch.inf) for each in nearby])


def _hidden(distance: Tensor, between: Tensor) -> bool:
    """True if one of the layers at distances `between`, (K, N) m, is in front wherever one at (N,) m is."""
    near = distance.isfinite()
    return bool(near.any() and (between.amin(0) < distance)[near].all())
