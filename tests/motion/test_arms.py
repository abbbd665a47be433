"""The winding number against the box that the points are in or out of."""

import torch
import trimesh

from uvcloth.motion.arms import winds_around


def test_a_surface_winds_around_what_is_inside_it() -> None:
    box = trimesh.creation.box(extents=(1.0, 2.0, 3.0))
    corners = torch.from_numpy(box.triangles.copy())
    grid = torch.linspace(-2.0, 2.0, 8, dtype=torch.float64)
    points = torch.cartesian_prod(grid, grid, grid)
    inside = (points.abs() < torch.tensor([0.5, 1.0, 1.5])).all(1)
    assert inside.sum() == 2 * 4 * 6
    assert torch.equal(winds_around(corners.expand(len(points), -1, -1, -1), points), inside)
