"""Rasterization of a UV layout: the mesh face of each texel, the papers' transference matrix T^UB."""

from dataclasses import dataclass

import torch
from torch import Tensor

from rasterize.layout import Layout


@dataclass(frozen=True)
class Texels:
    """The M texels of an H x W sheet whose centre lies on a face.

    Row 0 is the top of the sheet (v = 1), column 0 its left (u = 0); a texel's centre is at
    u = (column + 1/2) / W, v = 1 - (row + 1/2) / H. face: (M,) int64 MESH face. barycentrics: (M, 3), sum 1.
    pixels: (M,) int64, row * W + column, ascending. islands: (M,) int64 chart. uvs: (M, 2) of the centres.
    """

    height: int
    width: int
    face: Tensor
    barycentrics: Tensor
    pixels: Tensor
    islands: Tensor
    uvs: Tensor

    def __len__(self) -> int:
        return len(self.pixels)


def rasterize_layout(layout: Layout, size: int) -> Texels:
    """Find the texels of a size x size sheet (PhysXNet eq. 5, T^UB).

    A texel belongs to the face that holds its centre, the layout's first if that is on a common edge.
    All faces at once: each is paired with the texels in its bounding box, and the misses are dropped.
    """
    corners = layout.uvs.double()[layout.face_uvs] * size
    corners = torch.stack([corners[..., 0], size - corners[..., 1]], dim=-1)
    low = (corners.amin(1) - 0.5).ceil().long().clamp(0, size)
    high = (corners.amax(1) - 0.5).floor().long().clamp(-1, size - 1)
    columns, rows = (high - low + 1).clamp(min=0).unbind(1)
    boxes = columns * rows
    candidate = torch.arange(len(boxes)).repeat_interleave(boxes)
    place = torch.arange(len(candidate)) - (boxes.cumsum(0) - boxes)[candidate]
    column = low[candidate, 0] + place % columns[candidate]
    row = low[candidate, 1] + place // columns[candidate]
    centre = torch.stack([column, row], dim=1) + 0.5

    barycentrics = plane_barycentrics(centre, corners[candidate])
    inside = (barycentrics >= -1e-9).all(1)
    candidate, row, column = candidate[inside], row[inside], column[inside]
    barycentrics = barycentrics[inside].clamp(min=0.0)
    pixels = row * size + column
    # Stable, and candidates are in the order of the layout: the first of equals wins.
    pixels, order = pixels.sort(stable=True)
    first = torch.ones(len(pixels), dtype=torch.bool)
    first[1:] = pixels[1:] != pixels[:-1]
    pixels, order = pixels[first], order[first]
    winner = candidate[order]
    barycentrics = barycentrics[order]
    centres = torch.stack([pixels % size + 0.5, size - pixels // size - 0.5], dim=1) / size
    return Texels(
        height=size,
        width=size,
        face=layout.faces[winner],
        barycentrics=(barycentrics / barycentrics.sum(1, keepdim=True)).float(),
        pixels=pixels,
        islands=layout.islands[winner],
        uvs=centres.float(),
    )


def plane_barycentrics(points: Tensor, corners: Tensor) -> Tensor:
    """Barycentrics (n, 3) of points (n, 2) in triangles (n, 3, 2); not finite for a triangle without area."""
    a, b, c = corners.unbind(1)
    ab, ac, ap = b - a, c - a, points - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    second = (ap[:, 0] * ac[:, 1] - ap[:, 1] * ac[:, 0]) / area
    third = (ab[:, 0] * ap[:, 1] - ab[:, 1] * ap[:, 0]) / area
    return torch.stack([1 - second - third, second, third], dim=1)
