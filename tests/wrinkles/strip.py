"""A strip of cloth on two charts, for tests that need no human shape."""

import torch

from uvcloth.garments.garment import Garment
from uvcloth.geometry.mesh import Mesh

ACROSS, ALONG = 13, 25
"""Vertices of the strip along x and along y."""

SPACING = 0.02
"""Metres between two vertices."""

SEAM = 6
"""Column of vertices on which the charts meet."""


def strip(curvature: float = 0.0) -> Mesh:
    """A strip in the plane, or on a cylinder around y of a curvature, 1/m; charts at a quarter turn.

    The first chart lies as the strip does, at the scale of a metre a unit; the second one, of the columns
    from SEAM on, is turned by a quarter and lies to the right.
    """
    x, y = torch.meshgrid(torch.arange(ACROSS), torch.arange(ALONG), indexing="ij")
    x, y = (SPACING * each.flatten().float() for each in (x, y))
    if curvature:
        angle = curvature * x
        points = torch.stack([angle.sin() / curvature, y, (angle.cos() - 1.0) / curvature], 1)
    else:
        points = torch.stack([x, y, torch.zeros_like(x)], 1)
    index = torch.arange(ACROSS * ALONG).view(ACROSS, ALONG)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = torch.stack([a, b, c, a, c, d], -1).view(-1, 3)
    column = torch.arange(ACROSS - 1).repeat_interleave(2 * (ALONG - 1))
    first = torch.stack([x, y], 1) + 0.01
    # A quarter turn counter-clockwise: u = -y, v = x.
    second = torch.stack([-y, x - SEAM * SPACING], 1) + torch.tensor([0.98, 0.3])
    other = (column >= SEAM)[:, None]
    return Mesh(points, faces, torch.cat([first, second]), torch.where(other, faces + len(points), faces))


def garment(mesh: Mesh, name: str = "tops") -> Garment:
    """A garment of a mesh, on one joint."""
    weights = torch.ones(len(mesh.vertices), 1)
    return Garment(name, name, mesh, weights, weights, source="template")
