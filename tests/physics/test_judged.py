"""Cloth through itself and through the body, as another library, ipctk, judges it."""

import pytest
import torch
import trimesh
from torch import Tensor

from tests.physics import judge
from uvcloth.bodies.body import Body
from uvcloth.garments.templates import TEMPLATES, fit_template
from uvcloth.physics.outfit_clearing import CLEARANCE, OutfitClearing
from uvcloth.physics.self_intersection import crossing_edges_percent

WORN = [
    pytest.param(name, marks=() if name in ("tops", "skirt", "jacket") else pytest.mark.thorough)
    for name in TEMPLATES
]
"""Sleeves, an open hem and what is worn over others; the rest are of the same shapes."""


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


@pytest.mark.parametrize("name", WORN)
def test_a_garment_that_is_pulled_through_itself(name: str, body: Body) -> None:
    mesh = fit_template(name, body).mesh
    crossed = mesh.vertices.clone()
    front = crossed[:, 1] < crossed[:, 1].median()
    crossed[front] += torch.tensor([0.013, 0.25, 0.007])
    shares = crossing_edges_percent(torch.stack([mesh.vertices, crossed]), mesh.faces)
    assert not judge.meets_itself(mesh.vertices, mesh.faces)
    assert judge.meets_itself(crossed, mesh.faces)
    assert shares.tolist() == pytest.approx([0.0, judge.crossing_percent(crossed, mesh.faces)], abs=0.02)


def test_another_library_finds_a_shirt_and_the_body_apart_once_it_is_cleared(body: Body) -> None:
    mesh, skin = fit_template("tops", body).mesh, (body.mesh.vertices, body.mesh.faces)
    tight = mesh.vertices * torch.tensor([1.0, 0.9, 1.0])
    (cleared,) = OutfitClearing.of(body, [mesh]).cleared([tight], body.mesh.vertices)
    assert judge.meet(skin, (tight, mesh.faces))
    assert not judge.meet(skin, (cleared, mesh.faces))


@pytest.mark.parametrize("name", WORN)
def test_another_library_finds_a_template_and_the_body_apart_at_rest(name: str, body: Body) -> None:
    skin = (body.mesh.vertices, body.mesh.faces)
    mesh = fit_template(name, body).mesh
    (cleared,) = OutfitClearing.of(body, [mesh]).cleared([mesh.vertices], body.mesh.vertices)
    assert not judge.meet(skin, (cleared, mesh.faces))
    nearest = 0.015 if name == "jacket" else CLEARANCE + 1e-3  # There is room for a shirt beneath.
    assert 0 < judge.distance(skin, (cleared, mesh.faces), reach=0.02) < nearest
