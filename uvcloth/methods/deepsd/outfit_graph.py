"""Outfits as graphs that a network reads: many of different meshes packed one after another, none padded."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import accumulate

import torch
from torch import Tensor

from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.diffusion import chebyshev_sum, heat_shares
from uvcloth.geometry.mesh import face_normals, first_of, join_meshes, unique_edges, vertex_normals, weld
from uvcloth.geometry.operators import Operator, apply_linear
from uvcloth.physics.surface import BodySurface

LEAST_EDGE = 0.01
"""Of the distance that values spread over, the least edge that is looked at: 10,000 averages."""


@dataclass(frozen=True)
class OutfitGraph:
    """An outfit at rest, of N vertices; those at one place in one piece are one of its U points.

    owner: (N,) int64, which point each vertex is. points: (U, 3) m. faces: (F, 3) into them, per piece.
    offsets: (U, 3) m from the closest point of the skin. smooth, closest: (U, J) blend weights, the smooth
    ones of the baseline and those of the closest vertex of the body. joint_areas: (J,) share of the
    outfit's area that each joint and its descendants move by the smooth ones. fabric: (U, FEATURES) of their
    garments. rows: (U + 1,) and columns: (E,) int64, the neighbours of each point, itself among them, as
    compressed rows.
    """

    owner: Tensor
    points: Tensor
    faces: tuple[Tensor, ...]
    offsets: Tensor
    smooth: Tensor
    closest: Tensor
    joint_areas: Tensor
    fabric: Tensor
    rows: Tensor
    columns: Tensor

    @cached_property
    def normals(self) -> Tensor:
        """Unit vertex normals (U, 3)."""
        return vertex_normals(self.points, torch.cat(self.faces))

    @cached_property
    def edges(self) -> Tensor:
        """Edges (E, 2) int64, each once."""
        both = torch.stack([_row_of(self.rows), self.columns], dim=1)
        return both[both[:, 0] < both[:, 1]]


def outfit_graph(outfit: Outfit) -> OutfitGraph:
    """Make the graph of an outfit of one garment or more."""
    joined = join_meshes((garment.mesh.vertices, garment.mesh.faces) for garment in outfit.garments)
    places = [
        weld(garment.mesh.vertices) + start
        for garment, start in zip(outfit.garments, joined.starts, strict=True)
    ]
    owner = torch.cat(places).unique(return_inverse=True)[1]
    kept = first_of(owner)
    points = joined.vertices[kept]
    faces = tuple(
        owner[garment.mesh.faces + start]
        for garment, start in zip(outfit.garments, joined.starts, strict=True)
    )
    skin = BodySurface(outfit.body.mesh.vertices, outfit.body.mesh.faces).closest(points)
    rows, columns = _neighbours(torch.cat(faces), len(points))
    smooth = torch.cat([garment.smooth_weights for garment in outfit.garments])[kept]
    return OutfitGraph(
        owner=owner,
        points=points,
        faces=faces,
        offsets=points - skin.points,
        smooth=smooth,
        closest=torch.cat([garment.weights for garment in outfit.garments])[kept],
        joint_areas=_joint_areas(points, torch.cat(faces), smooth, outfit.body.skeleton.parents),
        fabric=torch.cat([_fabric(garment) for garment in outfit.garments])[kept],
        rows=rows,
        columns=columns,
    )


def _joint_areas(points: Tensor, faces: Tensor, weights: Tensor, parents: Sequence[int]) -> Tensor:
    """Share of the area that each joint moves together with its descendants (J,)."""
    areas = face_normals(points, faces).norm(dim=1, keepdim=True)
    shares = (areas * weights[faces].mean(1)).sum(0) / areas.sum()
    for joint, parent in reversed(list(enumerate(parents))):
        if parent >= 0:
            shares[parent] += shares[joint]
    return shares


def _fabric(garment: Garment) -> Tensor:
    """The fabric of a garment's vertices (N, FEATURES)."""
    return torch.tensor(garment.fabric.features()).expand(len(garment.mesh.vertices), -1)


def _neighbours(faces: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Neighbours of each of `count` points and itself as compressed rows: (count + 1,) and (E,)."""
    edges = unique_edges(faces)
    edges = edges[edges[:, 0] != edges[:, 1]]
    self_loops = torch.arange(count).expand(2, -1).T
    both = torch.cat([edges, edges.flip(1), self_loops])
    both = both[(both[:, 0] * count + both[:, 1]).argsort()]
    rows = torch.zeros(count + 1, dtype=torch.int64)
    rows[1:] = torch.bincount(both[:, 0], minlength=count).cumsum(0)
    return rows, both[:, 1]


@dataclass(frozen=True)
class PackedOutfits:
    """Points of several outfits, one outfit after another, on one device.

    sizes: points of each outfit. outfit: (U,) int64, whose each point is. points, normals, offsets: (U, 3).
    smooth: (U, J). joint_areas: (B, J). fabric: (U, FEATURES). average: the mean over a point's neighbours
    and itself. convolve: the operator of a graph convolution on values (B, U, C): that mean or, over a
    distance, the heat kernel.
    """

    sizes: tuple[int, ...]
    outfit: Tensor
    points: Tensor
    normals: Tensor
    offsets: Tensor
    smooth: Tensor
    joint_areas: Tensor
    fabric: Tensor
    average: Operator
    convolve: Callable[[Tensor], Tensor]


def pack(graphs: Sequence[OutfitGraph], device: torch.device, spread: float = 0.0) -> PackedOutfits:
    """Pack one outfit or more for one pass of the network; spread: m, of convolutions, 0 for neighbours."""
    sizes = tuple(len(graph.points) for graph in graphs)
    starts = list(accumulate(sizes, initial=0))
    entries = list(accumulate((len(graph.columns) for graph in graphs), initial=0))
    rows = torch.cat(
        [graph.rows[:-1] + entry for graph, entry in zip(graphs, entries[:-1], strict=True)]
        + [torch.tensor(entries[-1:])]
    )
    columns = torch.cat([graph.columns + start for graph, start in zip(graphs, starts[:-1], strict=True)])
    points = torch.cat([graph.points for graph in graphs])
    equal = 1.0 / rows.diff()
    average = _operator(rows, columns, equal, equal, device)

    def joined(name: str) -> Tensor:
        return torch.cat([getattr(graph, name) for graph in graphs]).to(device)

    return PackedOutfits(
        sizes=sizes,
        outfit=torch.arange(len(graphs)).repeat_interleave(torch.tensor(sizes)).to(device),
        points=joined("points"),
        normals=joined("normals"),
        offsets=joined("offsets"),
        smooth=joined("smooth"),
        joint_areas=torch.stack([graph.joint_areas for graph in graphs]).to(device),
        fabric=joined("fabric"),
        average=average,
        convolve=_heat(rows, columns, points, spread, device) if spread else average,
    )


def _heat(
    rows: Tensor, columns: Tensor, points: Tensor, spread: float, device: torch.device
) -> Callable[[Tensor], Tensor]:
    """The heat kernel by which values get `spread` metres away (root mean square), on edges of any length."""
    lengths = (points[_row_of(rows)] - points[columns]).norm(dim=1).square()
    others = (rows.diff() - 1).clamp(min=1)
    edge = (lengths.new_zeros(len(points)).index_add_(0, _row_of(rows), lengths) / others).sqrt()
    steps = (spread / edge.clamp(min=LEAST_EDGE * spread)).square()
    steps[rows.diff() == 1] = 0.0
    most = float(steps.max())
    # The kernel of the point with the most steps; the others rest in part of each.
    moves = steps / max(most, 1e-12)
    average = _operator(rows, columns, moves / others, 1.0 - moves, device)
    return partial(_heat_of, average, heat_shares(most))


def _heat_of(average: Operator, shares: Sequence[float], values: Tensor) -> Tensor:
    """The heat kernel of values (B, U, C)."""
    kernels = (
        partial(chebyshev_sum, partial(torch.mm, matrix), shares=shares)
        for matrix in (average.matrix, average.transposed)
    )
    return apply_linear(values, *kernels)


def _operator(
    rows: Tensor, columns: Tensor, others: Tensor, diagonal: Tensor, device: torch.device
) -> Operator:
    """Weighted sums of a point, by `diagonal` (U,), and of each neighbour, by `others` (U,)."""
    here = _row_of(rows)
    # Neighbourhood goes both ways: the transpose has the same places, and the weights of the column.
    return Operator(
        *(
            torch.sparse_csr_tensor(
                rows,
                columns,
                torch.where(here == columns, diagonal[here], others[whose]),
                (len(diagonal), len(diagonal)),
                check_invariants=False,
            ).to(device)
            for whose in (here, columns)
        )
    )


def _row_of(rows: Tensor) -> Tensor:
    """The row of each entry of compressed rows (U + 1,): (E,)."""
    return torch.arange(len(rows) - 1).repeat_interleave(rows.diff())
