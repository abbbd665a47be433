"""Padding across seams: pixels beside a chart show what lies there on the cloth, from the other chart."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rasterize.layout import Layout
from rasterize.texels import Texels

PADDING = 4.0
"""Pixels around each chart that are filled."""

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class SeamPadding:
    """The G pixels beside charts, and the texels of other charts that show what lies there on the cloth.

    pixels: (G,) of the flattened sheet. sources: (G,) texels. turns: (G, 2, 2) orthogonal, which turn
    directions on the sheet at the source into directions at the pixel. tensor_turns: (G, 3, 3), the same for
    the entries 00, 11, 01 of symmetric tensors.
    """

    pixels: Tensor
    sources: Tensor
    turns: Tensor
    tensor_turns: Tensor

    def beside(self, rows: Tensor, tensors: slice, vectors: slice) -> Tensor:
        """Values (..., G, C) at the pixels from rows (..., P, C) at the texels.

        tensors: channels, in threes, of symmetric tensors; vectors: in twos, of vectors along u and v.
        """
        values = rows[..., self.sources, :]
        for part, turns in ((tensors, self.tensor_turns), (vectors, self.turns)):
            grouped = values[..., part].unflatten(-1, (-1, turns.shape[-1]))
            values[..., part] = (grouped @ turns.mT).flatten(-2)
        return values


def seam_padding(layout: Layout, faces: Tensor, texels: Texels) -> SeamPadding:
    """Find the padding of a layout. faces: (F, 3) of the welded mesh, so that charts share vertices at seams.

    Beyond a hem there is nothing, and its pixels stay zero.
    """
    size = texels.width
    start, end, inward, twin = _seam_edges(layout, faces.numpy(), size)
    taken = np.zeros(size * size, bool)
    taken[texels.pixels.numpy()] = True
    free = np.flatnonzero(~taken)
    centres = np.stack([free % size + 0.5, size - free // size - 0.5], 1)
    if not len(start):
        nothing = torch.zeros(0, dtype=torch.int64)
        return SeamPadding(nothing, nothing, torch.zeros(0, 2, 2), torch.zeros(0, 3, 3))
    edge, share, away = _nearest_edges(centres, start, end, inward)
    near = (away < PADDING) & (twin[edge] >= 0)
    free, edge, share, away = free[near], edge[near], share[near], away[near]
    other = twin[edge]
    # The twin runs the other way round its chart, so that its shares count from its end.
    places = start[other] + (1.0 - share)[:, None] * (end - start)[other] + away[:, None] * inward[other]
    column = np.clip(np.floor(places[:, 0]).astype(int), 0, size - 1)
    row = np.clip(np.floor(size - places[:, 1]).astype(int), 0, size - 1)
    sources = _nearest_texel(row * size + column, texels)
    along, along_other = (_unit(end - start)[each] for each in (edge, other))
    # From (end to start, inwards) of the twin to (start to end, outwards) of the chart.
    turns = np.einsum("gi,gj->gij", along, -along_other) + np.einsum(
        "gi,gj->gij", -inward[edge], inward[other]
    )
    turned = torch.from_numpy(turns).float()
    return SeamPadding(torch.from_numpy(free), torch.from_numpy(sources), turned, _tensor_turns(turned))


def _tensor_turns(turns: Tensor) -> Tensor:
    """Products (G, 3, 3) for entries 00, 11, 01 of symmetric tensors S that are turned to R S R^T."""
    (a, b), (c, d) = (row.unbind(1) for row in turns.unbind(1))
    rows = [a * a, b * b, 2.0 * a * b, c * c, d * d, 2.0 * c * d, a * c, b * d, a * d + b * c]
    return torch.stack(rows, dim=1).view(-1, 3, 3)


def _seam_edges(layout: Layout, faces: Indices, size: int) -> tuple[Floats, Floats, Floats, Indices]:
    """Edges (B, 2) of charts in pixels, v up: starts, ends, unit normals inwards; and the twin of each (B,).

    Twins are -1 at hems.
    """
    corners = faces[layout.faces.numpy()]
    on_sheet = layout.face_uvs.numpy()
    uvs = layout.uvs.double().numpy() * size
    edge_corners = np.stack([corners, np.roll(corners, -1, 1)], 2).reshape(-1, 2)
    edge_uvs = np.stack([on_sheet, np.roll(on_sheet, -1, 1)], 2).reshape(-1, 2)
    third = np.roll(on_sheet, -2, 1).reshape(-1)
    ordered = np.sort(edge_uvs, 1)
    _, which, counts = np.unique(
        ordered[:, 0] * len(uvs) + ordered[:, 1], return_inverse=True, return_counts=True
    )
    rim = np.flatnonzero(counts[which] == 1)
    ends = np.sort(edge_corners[rim], 1)
    keys = ends[:, 0] * (int(corners.max()) + 1) + ends[:, 1]
    order = np.argsort(keys, kind="stable")
    twin = np.full(len(rim), -1)
    pairs = np.flatnonzero(keys[order][1:] == keys[order][:-1])
    first, second = order[pairs], order[pairs + 1]
    # Faces on both sides run along their common edge in opposite directions, if the surface is oriented.
    opposite = edge_corners[rim[first], 0] == edge_corners[rim[second], 1]
    twin[first[opposite]], twin[second[opposite]] = second[opposite], first[opposite]
    start, end = uvs[edge_uvs[rim, 0]], uvs[edge_uvs[rim, 1]]
    along = _unit(end - start)
    normal = np.stack([-along[:, 1], along[:, 0]], 1)
    side = ((uvs[third[rim]] - start) * normal).sum(1, keepdims=True)
    return start, end, np.where(side < 0, -normal, normal), twin


def _nearest_edges(
    points: Floats, start: Floats, end: Floats, inward: Floats
) -> tuple[Indices, Floats, Floats]:
    """Nearest edge (P,) on whose outer side each point lies, the share along it, and the distance."""
    best = np.zeros(len(points), int)
    least, share_of = np.full(len(points), np.inf), np.zeros(len(points))
    along = end - start
    squared = np.maximum((along**2).sum(1), 1e-12)
    for rows in np.array_split(np.arange(len(points)), max(1, len(points) // 512)):
        ways = points[rows, None] - start
        share = np.clip((ways * along).sum(2) / squared, 0.0, 1.0)
        off = np.linalg.norm(ways - share[..., None] * along, axis=2)
        off = np.where((ways * inward).sum(2) > 1e-9, np.inf, off)
        nearest = off.argmin(1)
        some = np.arange(len(rows))
        best[rows], least[rows], share_of[rows] = nearest, off[some, nearest], share[some, nearest]
    return best, share_of, least


def _nearest_texel(pixels: Indices, texels: Texels) -> Indices:
    """The texel (G,) that is nearest to each pixel (G,)."""
    from scipy.spatial import KDTree

    size, taken = texels.width, texels.pixels.numpy()
    tree = KDTree(np.stack([taken // size, taken % size], 1))
    nearest: Indices = tree.query(np.stack([pixels // size, pixels % size], 1))[1]
    return nearest


def _unit(ways: Floats) -> Floats:
    return ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-12)
