"""Strain limiting: moves vertices until edge lengths are plausible for cloth, and reduces bending."""

import torch
from torch import Tensor

from uvcloth.geometry.mesh import unique_edges, weld
from uvcloth.physics import kernels
from uvcloth.physics.launch import array, record, run

CORRECTION_STEP = 1.8
"""Factor on the mean correction by a vertex's edges; 2 oscillates where all neighbours move alike."""

SPECTRAL_RADIUS = 0.995
"""Spectral radius that the Chebyshev weights are made for: near 1, long waves converge fast."""

BENDING_CORRECTION = 0.04
"""Share of the curvature beyond that at rest which a pass undoes: without it folds are as small as edges."""

STRETCH = 1.03
"""Longest edges that are kept, over their length at rest: jersey stretches this much under its own weight."""

PLAIN_PASSES = 2
"""First passes, without momentum, which remove the largest errors."""


class StrainLimiter:
    """A garment's edges and its shape at rest; vertices at one place there (UV seams) are one.

    The shape is the length of each edge and, as the curvature at a vertex, the length of the mean of the
    vectors to its neighbours. vertices: (N, 3) at rest, m. faces: (M, 3). It runs on the device of
    `vertices`.
    """

    def __init__(self, vertices: Tensor, faces: Tensor) -> None:
        device = vertices.device
        self.owner = weld(vertices)
        edges = unique_edges(self.owner[faces])
        ends = torch.cat([edges, edges.flip(1)])
        ends = ends[ends[:, 0].argsort(stable=True)]
        vectors = vertices[ends[:, 1]] - vertices[ends[:, 0]]
        first = torch.searchsorted(ends[:, 0].contiguous(), torch.arange(len(vertices) + 1, device=device))
        total = torch.zeros_like(vertices).index_add(0, ends[:, 0], vectors)
        curvatures = total.norm(dim=1) / first.diff().clamp(min=1)
        lengths = vectors.norm(dim=1).float()
        self._ends, self._lengths = ends, lengths
        self._neighbours = (array(first.int()), array(ends[:, 1].int().contiguous()))
        self._curvatures = array(curvatures.float())

    def relax(
        self, vertices: Tensor, passes: int, normals: Tensor, offsets: Tensor, predicted: Tensor
    ) -> Tensor:
        """Even out the edges of a garment (N, 3), m, and keep it on the outer side of planes.

        Jacobi iterations with Chebyshev weights (Wang 2015): short waves converge first, so that the shape
        stays. passes: number of iterations. normals: (N, 3) and offsets: (N,) m, the least product of a
        vertex with its normal. predicted: (N, 3) m, whose edge lengths are kept within 1 to STRETCH times
        those at rest.
        """
        lengths = array(self._allowed(predicted))
        now = vertices[self.owner].float()
        before = now.clone()
        planes = (array(normals.float().contiguous()), array(offsets.float().contiguous()))
        shape = (*self._neighbours, lengths, self._curvatures)
        amounts = (CORRECTION_STEP, BENDING_CORRECTION, 1.0)
        places, device = (array(now), array(before)), vertices.device
        there, back = (
            record(kernels.project_edges, len(now), device, *ends, *shape, *planes, *amounts)
            for ends in (places, places[::-1])
        )
        weight = 1.0
        for turn in range(passes):
            weight = _weight(turn, passes, weight)
            for share in there:
                share.set_param_by_name("momentum", weight)
            run(there, device)
            there, back = back, there
        return (before if passes % 2 else now)[self.owner]

    def _allowed(self, predicted: Tensor) -> Tensor:
        """Lengths (E,) m that edges shall have, of those of a prediction (N, 3) m."""
        ends = predicted[self.owner].float()[self._ends]
        return (ends[:, 1] - ends[:, 0]).norm(dim=1).clamp(min=self._lengths, max=STRETCH * self._lengths)


def _weight(turn: int, passes: int, before: float) -> float:
    """The Chebyshev weight of a pass; the first ones and the last are plain."""
    if turn < PLAIN_PASSES or turn == passes - 1:
        return 1.0
    square = SPECTRAL_RADIUS**2
    return 2.0 / (2.0 - square) if turn == PLAIN_PASSES else 4.0 / (4.0 - square * before)
