"""Pixels at fault of panels that were pushed behind what they hide, over a known part of their area."""

import pytest
import torch
import trimesh
from torch import Tensor

from evaluate.pixels import make_sight, pixel_scores
from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.physics.exposure import Exposure

PANEL, PATCH = 0.4, 0.1
"""Sides of a panel and of the square of it that is pushed, m."""

FAULT = 100.0 * (PATCH / PANEL) ** 2
"""Percent of a panel's pixels that show what is behind it, seen from its front."""


def as_mesh(vertices: Tensor, faces: Tensor) -> Mesh:
    return Mesh(vertices, faces, vertices[:, :2], faces)


def panel(depth: float) -> Mesh:
    """A square that faces the front (-Y), so far behind the plane y = 0, m, its middle at z = 1."""
    count = 81
    x, z = torch.meshgrid(*2 * [torch.linspace(-0.5 * PANEL, 0.5 * PANEL, count)], indexing="ij")
    vertices = torch.stack([x, torch.full_like(x, depth), 1.0 + z], dim=-1).reshape(-1, 3)
    row, column = torch.meshgrid(*2 * [torch.arange(count - 1)], indexing="ij")
    a = (row * count + column).reshape(-1)
    faces = torch.cat(
        [torch.stack([a, a + count, a + 1], 1), torch.stack([a + 1, a + count, a + 1 + count], 1)]
    )
    return as_mesh(vertices, faces)


def pushed(mesh: Mesh, back: float) -> Tensor:
    """Vertices of a panel whose middle square is moved back, m."""
    middle = ((mesh.vertices - torch.tensor([0.0, 0.0, 1.0]))[:, [0, 2]].abs() <= 0.5 * PATCH).all(1)
    return mesh.vertices + middle[:, None] * torch.tensor([0.0, back, 0.0])


@pytest.fixture(scope="module")
def slab() -> Body:
    """A body whose front is 2 cm behind the plane y = 0, and much wider than a panel."""
    box = trimesh.creation.box((1.0, 0.2, 1.8)).subdivide_loop(0).subdivide().subdivide().subdivide()
    shape = torch.tensor(box.vertices).float() + torch.tensor([0.0, 0.12, 0.9])
    faces = torch.tensor(box.faces).long()
    flat = torch.zeros(len(faces), dtype=torch.long)
    skeleton = Skeleton(("hips",), (-1,), torch.zeros(1, 3))
    return Body("slab", as_mesh(shape, faces), skeleton, torch.ones(len(shape), 1), flat, flat, {})


def shares(body: Body, meshes: list[Mesh], frames: list[Tensor]) -> dict[str, list[float]]:
    """Percent of pixels at fault of garments, all as one, in some frames."""
    sight = make_sight(body, meshes, Exposure(body, meshes).covered_faces)
    scores = pixel_scores(sight, torch.stack(frames), body.mesh.vertices.expand(len(frames), -1, -1))
    return {key: values.tolist() for key, values in scores.items()}


def test_skin_shows_where_cloth_was_pushed_into_the_body_and_not_where_it_was_taken_away(slab: Body) -> None:
    cloth = panel(0.0)
    aside = cloth.vertices + torch.tensor([0.3, 0.0, 0.0])
    found = shares(slab, [cloth], [cloth.vertices, pushed(cloth, 0.03), pushed(cloth, 0.2), aside])
    assert found["skin_pixels_percent"] == pytest.approx([0.0, FAULT, 0.0, 0.0], abs=0.8)
    assert found["cloth_pixels_percent"] == [0.0] * 4


def test_an_inner_garment_and_an_inner_side_show_where_the_outer_one_was_pushed(slab: Body) -> None:
    outer, inner = panel(-0.01), panel(0.0)
    layers = shares(slab, [inner, outer], [torch.cat([inner.vertices, pushed(outer, 0.018)])])
    assert layers["cloth_pixels_percent"] == pytest.approx([FAULT], abs=0.8)
    assert layers["skin_pixels_percent"] == [0.0]
    # One garment: a front, and behind it the inner side of its back.
    both = as_mesh(
        torch.cat([outer.vertices, inner.vertices]),
        torch.cat([outer.faces, inner.faces.flip(1) + len(outer.vertices)]),
    )
    pushed_in = torch.cat([pushed(outer, 0.018), inner.vertices])
    assert shares(slab, [both], [both.vertices, pushed_in])["cloth_pixels_percent"] == pytest.approx(
        [0.0, FAULT], abs=0.8
    )
