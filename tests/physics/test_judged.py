"""Cloth through itself and through the body, as another library, ipctk, judges it."""

import pytest
import torch
import trimesh
from torch import Tensor

from tests.physics import judge
from tests.physics.test_contact import dressed, ellipsoid, grid, obstacle, tensors
from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.garments.templates import TEMPLATES, fit_template
from uvcloth.physics.contact import SKIN_CLEARANCE, Obstacle
from uvcloth.physics.self_intersection import crossing_edges_percent


def balls(apart: float) -> tuple[Tensor, Tensor]:
    """Two balls of radius 1, so far apart."""
    first, second = (trimesh.creation.icosphere(3) for _ in range(2))
    second.apply_translation([apart, 0.03, 0.01])
    both = trimesh.util.concatenate([first, second])
    return torch.tensor(both.vertices).float(), torch.tensor(both.faces).long()


def test_the_same_edges_cross_as_in_another_library() -> None:
    frames = [balls(apart) for apart in (0.9, 1.5, 2.1)]
    shares = crossing_edges_percent(torch.stack([vertices for vertices, _ in frames]), frames[0][1])
    assert [judge.meets_itself(*frame) for frame in frames] == [True, True, False]
    assert shares.tolist() == pytest.approx([judge.crossing_percent(*frame) for frame in frames], abs=1e-4)


def test_a_garment_that_is_pulled_through_itself(body: Body) -> None:
    for name in TEMPLATES:
        mesh = fit_template(name, body).mesh
        crossed = mesh.vertices.clone()
        front = crossed[:, 1] < crossed[:, 1].median()
        crossed[front] += torch.tensor([0.013, 0.25, 0.007])
        shares = crossing_edges_percent(torch.stack([mesh.vertices, crossed]), mesh.faces)
        assert not judge.meets_itself(mesh.vertices, mesh.faces)
        assert judge.meets_itself(crossed, mesh.faces)
        assert shares.tolist() == pytest.approx([0.0, judge.crossing_percent(crossed, mesh.faces)], abs=0.02)


def test_another_library_finds_cloth_and_body_apart_after_contact() -> None:
    """A sheet over a sphere that does not meet it is outside of it: no distance is negative."""
    ball = ellipsoid(0.3, 0.3, 0.3)
    x, y = torch.meshgrid(*[torch.linspace(-0.3, 0.3, 41)] * 2, indexing="ij")
    sheet = torch.stack([x.flatten(), y.flatten(), torch.full((41 * 41,), 0.28)], dim=1)
    faces, worn = grid(41, 41), obstacle(ball)
    garment = dressed(sheet, faces)
    resolved, _ = worn.resolve(sheet, garment)
    assert judge.meet(tensors(ball), (sheet, faces))
    assert not judge.meet(tensors(ball), (resolved, faces))
    found = judge.distance(tensors(ball), (resolved, faces), reach=0.02)
    ours = float(worn.skin(resolved, garment).distance.min())
    # Between the vertices the sheet is a little nearer than they are.
    assert 0 < found <= ours + 1e-6
    assert found > ours - 0.002


def test_another_library_finds_templates_and_body_apart_at_rest(body: Body) -> None:
    worn = Obstacle(make_collider(body), body.mesh.vertices)
    for name in TEMPLATES:
        mesh = fit_template(name, body).mesh
        resolved, _ = worn.resolve(mesh.vertices, worn.contact_garment(mesh.vertices, mesh.faces))
        skin = (body.mesh.vertices, body.mesh.faces)
        assert not judge.meet(skin, (resolved, mesh.faces))
        nearest = 0.015 if name == "jacket" else SKIN_CLEARANCE + 1e-4  # There is room for a shirt beneath.
        assert 0 < judge.distance(skin, (resolved, mesh.faces), reach=0.02) < nearest
