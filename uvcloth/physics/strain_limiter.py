"""Strain limiting: moves vertices until edge lengths are plausible for cloth, and reduces bending."""

import torch
from torch import Tensor

from uvcloth.geometry.mesh import unique_edges, weld
from uvcloth.player.surface_graph import SurfaceGraph

STRETCH = 1.03
"""Longest edges that are kept, over their length at rest: jersey stretches this much under its own weight."""


class StrainLimiter:
    """A garment's edges and its shape at rest; vertices at one place there (UV seams) are one.

    The shape is the length of each edge and, as the curvature at a vertex, the length of the mean of the
    vectors to its neighbours. vertices: (N, 3) at rest, m. faces: (M, 3).
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
        self._ends, self._lengths = ends, vectors.norm(dim=1).float()
        self._first, self._curvatures = first.cpu().numpy(), curvatures.cpu().numpy()

    def relax(
        self, vertices: Tensor, passes: int, normals: Tensor, offsets: Tensor, predicted: Tensor
    ) -> Tensor:
        """Even out the edges of a garment (N, 3), m, and keep it on the outer side of planes.

        Jacobi iterations with Chebyshev weights (Wang 2015): short waves converge first, so that the shape
        stays. passes: number of iterations. normals: (N, 3) and offsets: (N,) m, the least product of a
        vertex with its normal. predicted: (N, 3) m, whose edge lengths are kept within 1 to STRETCH times
        those at rest.
        """
        lengths = self._allowed(predicted)
        graph = SurfaceGraph(self._first, *(each.cpu().numpy() for each in (self._ends[:, 1], lengths)))
        now, directions, limits = (
            each.detach().cpu().numpy() for each in (vertices[self.owner], normals, offsets)
        )
        evened = graph.even_edges(now, self._curvatures, directions, limits, passes)
        return torch.from_numpy(evened).to(vertices.device)[self.owner]

    def _allowed(self, predicted: Tensor) -> Tensor:
        """Lengths (E,) m that edges shall have, of those of a prediction (N, 3) m."""
        ends = predicted[self.owner].float()[self._ends]
        return (ends[:, 1] - ends[:, 0]).norm(dim=1).clamp(min=self._lengths, max=STRETCH * self._lengths)
