"""A box of eight vertices on two joints: the smallest body that poses, for tests that need no human shape."""

import torch

from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skeleton import Skeleton


def small_body(scale: float = 1.0, flipped: bool = False) -> Body:
    """A cube on a hip and a chest joint; `flipped` turns one face around, which makes it another topology."""
    grid = torch.cartesian_prod(*[torch.tensor([-0.1, 0.1])] * 3) * scale
    faces = torch.tensor(
        [
            [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
            [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
        ]
    )  # fmt: skip
    if flipped:
        faces[0] = faces[0].flip(0)
    weights = torch.stack([(grid[:, 2] < 0).float(), (grid[:, 2] > 0).float()], dim=1)
    heads = torch.tensor([[0.0, 0.0, -0.1], [0.0, 0.0, 0.0]])
    return Body(
        name="box",
        mesh=Mesh(grid, faces, grid[:, :2] + 0.5, faces),
        skeleton=Skeleton(("hips", "chest"), (-1, 0), heads),
        weights=weights,
        regions=torch.zeros(len(faces), dtype=torch.int64),
        sides=torch.zeros(len(faces), dtype=torch.int64),
        proxies={},
    )
