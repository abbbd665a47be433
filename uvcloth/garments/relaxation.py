"""Settling of a garment on a body: out of the skin, with its edges near their length."""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import edge_lengths, neighbour_average, unique_edges, weld
from uvcloth.physics.strain_limiter import StrainLimiter
from uvcloth.physics.surface import FREE, BodySurface

CLEARANCE = 0.004
"""Metres that settled cloth keeps off the skin."""

ROUNDS, PASSES = 24, 12
"""Rounds of searching the skin, and passes over the edges in each."""

FINAL_ROUNDS = 6
"""Rounds at the end that only move cloth out of the skin."""

NEAR = 0.05
"""Metres from the skin within which cloth is kept off it."""

LARGEST_STEP = 0.01
"""Metres that cloth moves off or towards the skin in a round, at most."""


@dataclass(frozen=True)
class Relaxed:
    """Vertices (N, 3) m of a garment, distances (N,) m from the start, and edges (E,) over their length."""

    vertices: Tensor
    distances: Tensor
    stretch: Tensor

    @property
    def off(self) -> float:
        """Share of its length by which an edge differs, for 95 % of them at most."""
        return float((self.stretch - 1.0).abs().quantile(0.95))

    def text(self) -> str:
        """Description of how much settling changed; one line."""
        return (
            f"settled on the skin, moved by up to {1000 * float(self.distances.max()):.0f} mm; 95 % of the "
            f"edges are within {100 * self.off:.0f} % of their length"
        )


@dataclass(frozen=True)
class Ease:
    """Least and greatest distances from the skin, (N,) m, that a garment keeps."""

    least: Tensor
    most: Tensor


def settle(start: Tensor, faces: Tensor, natural: Tensor, body: Body, ease: Ease | None = None) -> Relaxed:
    """Settle a garment at (N, 3) m on a body; natural: (N, 3) m, where its edges have their length.

    ease: None for no less than CLEARANCE. Vertices at one place in `natural` stay together.
    """
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    limiter, owner = StrainLimiter(natural, faces), weld(natural)
    average = neighbour_average(owner[faces], len(start))
    ease = ease or Ease(torch.full((len(start),), CLEARANCE), torch.full((len(start),), torch.inf))
    vertices = start[owner]
    for _ in range(ROUNDS):
        skin = surface.closest(vertices)
        wanted = skin.signed_distance.clamp(min=ease.least, max=ease.most)
        step = (wanted - skin.signed_distance).clamp(min=-LARGEST_STEP, max=LARGEST_STEP)
        move = step[:, None] * skin.normals
        vertices = vertices + torch.where(step[:, None] != 0, move, average @ move)
        # A plane holds cloth that is still inside where it is, and all other cloth at its least distance.
        clear = (skin.points * skin.normals).sum(1) + ease.least
        offsets = torch.minimum((vertices * skin.normals).sum(1), clear)
        offsets = torch.where(skin.signed_distance < NEAR, offsets, FREE)
        vertices = limiter.relax(vertices, PASSES, skin.normals, offsets, natural)
    for _ in range(FINAL_ROUNDS):
        skin = surface.closest(vertices)
        wanted = skin.signed_distance.clamp(min=ease.least, max=ease.most)
        vertices = vertices + (wanted - skin.signed_distance)[:, None] * skin.normals
    edges = unique_edges(owner[faces])
    stretch = edge_lengths(vertices, edges) / edge_lengths(natural, edges).clamp(min=1e-6)
    return Relaxed(vertices[owner], (vertices - start).norm(dim=1), stretch)
