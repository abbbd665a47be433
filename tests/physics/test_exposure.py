"""Skin that shows through cloth, where its share is known in advance."""

import math
from dataclasses import replace

import pytest
import torch
import trimesh
from torch import Tensor

from tests.physics import judge
from uvcloth.bodies.body import Body
from uvcloth.garments.templates import TEMPLATES, fit_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.physics.exposure import Exposure, spread

RADIUS = 0.1
"""Of the limb."""


def tensors(shape: trimesh.Trimesh) -> tuple[Tensor, Tensor]:
    return torch.tensor(shape.vertices).float(), torch.tensor(shape.faces).long()


def limb(*others: trimesh.Trimesh) -> Body:
    """A cylinder around z, 0.8 m long, with what else belongs to the body."""
    vertices, faces = tensors(
        trimesh.util.concatenate([trimesh.creation.cylinder(RADIUS, 0.8, sections=256), *others])
    )
    flat = torch.zeros(len(faces), dtype=torch.long)
    mesh = Mesh(vertices, faces, vertices[:, :2], faces)
    skeleton = Skeleton(("hips",), (-1,), torch.zeros(1, 3))
    return Body("limb", mesh, skeleton, torch.ones(len(vertices), 1), flat, flat, {})


def sleeve(radius: float, sections: int) -> Mesh:
    """A prism around the limb whose vertices are at that radius, 0.4 m long."""
    shape = trimesh.creation.cylinder(radius, 0.4, sections=sections)
    shape.update_faces(abs(shape.face_normals[:, 2]) < 0.5)
    shape.remove_unreferenced_vertices()
    vertices, faces = tensors(shape)
    return Mesh(vertices, faces, vertices[:, :2], faces)


def test_spread_points_stand_for_equal_areas() -> None:
    vertices, faces = tensors(trimesh.creation.box((3.0, 1.0, 0.5)).subdivide())
    sample = spread(vertices, faces, 4000)
    points = sample.points(vertices)
    share = torch.tensor(
        [(points[:, axis].abs() > side - 1e-6).float().mean() for axis, side in enumerate((1.5, 0.5, 0.25))]
    )
    areas = torch.tensor([1.0 * 0.5, 3.0 * 0.5, 3.0 * 1.0])
    torch.testing.assert_close(share, areas / areas.sum(), atol=2e-3, rtol=0)
    # On the top, x^2 and xy average as the integrals over the rectangle say.
    top = points[points[:, 2] > 0.25 - 1e-6]
    assert float(top[:, 0].square().mean()) == pytest.approx(0.75, abs=0.01)
    assert float((top[:, 0] * top[:, 1]).mean()) == pytest.approx(0.0, abs=0.01)
    assert float(top[:, 1].square().mean()) == pytest.approx(1 / 12, abs=0.002)
    assert sample.barycentrics.min() >= 0
    assert torch.equal(points, spread(vertices, faces, 4000).points(vertices))


def test_spread_points_move_with_their_faces() -> None:
    vertices, faces = tensors(trimesh.creation.icosphere(2))
    sample = spread(vertices, faces, 100)
    frames = torch.stack([vertices, 2.0 * vertices + 1.0])
    torch.testing.assert_close(sample.points(frames)[1], 2.0 * sample.points(vertices) + 1.0)


def test_faces_that_cut_through_the_body_are_found_while_all_vertices_are_outside() -> None:
    """A six-sided sleeve: where its flat sides are nearer to the axis than the skin, the skin shows."""
    rest, tight = sleeve(0.13, 6), sleeve(0.11, 6)
    assert tight.vertices[:, :2].norm(dim=1).min() > RADIUS
    body = limb()
    skin = (body.mesh.vertices, body.mesh.faces)
    assert not judge.meet(skin, (rest.vertices, rest.faces))
    assert judge.meet(skin, (tight.vertices, tight.faces))
    exposure = Exposure(body, [rest])
    assert exposure.percent([rest.vertices], body.mesh.vertices) == 0.0
    expected = 100.0 * math.acos(0.11 * math.cos(math.pi / 6) / RADIUS) / (math.pi / 6)
    assert exposure.percent([tight.vertices], body.mesh.vertices) == pytest.approx(expected, abs=2.0)
    # The covered skin is as long as the sleeve.
    heights = exposure.covered.points(body.mesh.vertices)[:, 2]
    assert heights.abs().max() == pytest.approx(0.2, abs=0.01)


def test_skin_that_a_hem_leaves_bare_does_not_show_through() -> None:
    rest, body = sleeve(0.12, 64), limb()
    exposure = Exposure(body, [rest])
    ridden_up = rest.vertices + torch.tensor([0.0, 0.0, 0.3])
    assert exposure.percent([ridden_up], body.mesh.vertices) == 0.0
    sunk = rest.vertices * torch.tensor([0.7, 0.7, 1.0]) + torch.tensor([0.0, 0.0, 0.2])
    assert exposure.percent([sunk], body.mesh.vertices) == pytest.approx(50.0, abs=1.5)


def test_an_outer_garment_or_a_limb_hides_what_sticks_through_an_inner_one() -> None:
    inner, outer = sleeve(0.12, 64), sleeve(0.14, 64)
    sunk = inner.vertices * torch.tensor([0.7, 0.7, 1.0])
    body = limb()
    both = Exposure(body, [inner, outer])
    assert both.percent([sunk, outer.vertices], body.mesh.vertices) == 0.0
    half = outer.vertices + torch.tensor([0.0, 0.0, 0.2])
    assert both.percent([sunk, half], body.mesh.vertices) == pytest.approx(50.0, abs=1.5)
    wall = trimesh.creation.box((0.2, 1.0, 1.0))
    wall.apply_translation([1.0, 0.0, 0.0])
    walled = limb(wall)
    near = walled.mesh.vertices.clone()
    near[len(body.mesh.vertices) :, 0] -= 0.8
    alone = Exposure(walled, [inner])
    assert alone.percent([sunk], walled.mesh.vertices) == pytest.approx(100.0, abs=0.5)
    # The wall now stands at x = 0.1, against the limb: it hides the half that looks at it from up to 10 cm.
    assert 40.0 < alone.percent([sunk], near) < 75.0


def test_templates_at_rest_let_no_skin_through_and_sunk_ones_do(body: Body) -> None:
    for name in TEMPLATES:
        mesh = fit_template(name, body).mesh
        exposure = Exposure(body, [mesh])
        assert len(exposure.covered.corners) > 2500
        assert exposure.percent([mesh.vertices], body.mesh.vertices) == pytest.approx(0.0, abs=0.05)
        shoved = mesh.vertices + torch.tensor([0.0, 0.03, 0.0])
        assert 5.0 < exposure.percent([shoved], body.mesh.vertices) < 60.0


def test_what_covers_nothing_shows_nothing(body: Body) -> None:
    mesh = fit_template("tops", body).mesh
    above = replace(mesh, vertices=mesh.vertices + torch.tensor([0.0, 0.0, 3.0]))
    assert Exposure(body, [above]).percent([above.vertices], body.mesh.vertices) == 0.0
