"""Cloth that lies beneath skin in sight is moved over it."""

import pytest
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh, vertex_normals, weld
from uvcloth.physics.exposure import Exposure
from uvcloth.physics.outfit_clearing import COVERED_POINTS, OutfitClearing
from uvcloth.player.clearing import Clearing

SUNK, OVER = 0.025, 0.002


def cover(body: Body, mesh: Mesh, cloth: Tensor) -> Tensor:
    """Cloth of a mesh moved over the skin of the body at rest."""
    owners, places = weld(mesh.vertices).unique(return_inverse=True)
    moved = cloth[owners].contiguous()
    OutfitClearing.of(body, [mesh]).fine.cover(moved.numpy(), body.mesh.vertices.numpy())
    return moved[places]


@pytest.fixture(scope="module")
def sunk(body: Body) -> tuple[Mesh, Tensor, Tensor]:
    """A T-shirt, its vertices with a dent into the belly, and the mask of those that are in it."""
    mesh = fit_template("tops", body).mesh
    belly = mesh.vertices[mesh.vertices[:, 1].argmin()]
    dent = (mesh.vertices - belly).norm(dim=1) < 0.08
    normals = vertex_normals(mesh.vertices, mesh.faces)
    return mesh, mesh.vertices - SUNK * dent[:, None] * normals, dent


def test_cloth_beneath_skin_in_sight_is_moved_over_it(body: Body, sunk: tuple[Mesh, Tensor, Tensor]) -> None:
    mesh, vertices, dent = sunk
    exposure = Exposure(body, [mesh], COVERED_POINTS)
    shown = exposure.percent([vertices], body.mesh.vertices)
    assert shown > 1.0
    cloth = cover(body, mesh, vertices)
    assert exposure.percent([cloth], body.mesh.vertices) < 0.1 * shown
    ways = (cloth - vertices).norm(dim=1)
    assert 0.0 < ways.max() < 2.0 * (SUNK + OVER)
    beside = torch.zeros_like(dent)
    beside[mesh.faces[dent[mesh.faces].any(1)]] = True
    for _ in range(2):
        beside[mesh.faces[beside[mesh.faces].any(1)]] = True
    assert torch.equal(cloth[~beside], vertices[~beside])


def test_cloth_over_the_skin_keeps_its_bits(body: Body) -> None:
    mesh = fit_template("dress", body).mesh
    assert torch.equal(cover(body, mesh, mesh.vertices), mesh.vertices)


def test_cloth_of_another_limb_is_left_where_it_is(body: Body) -> None:
    """A sleeve inside the chest, as an arm takes it there, is not put over it."""
    mesh = fit_template("shirt", body).mesh
    cloth = mesh.vertices.clone()
    cuff, trunk = cloth[:, 0] > cloth[:, 0].max() - 0.06, cloth[:, 0].abs() < 0.12
    cloth[cuff] += torch.tensor([-0.05, -0.08, 0.62]) - cloth[cuff].mean(0)
    cloth[trunk] += torch.tensor([0.0, 0.3, 0.0])
    before = cloth.clone()
    assert len(Exposure(body, [mesh]).shown([cloth], body.mesh.vertices).rows)
    cloth = cover(body, mesh, cloth)
    assert torch.equal(cloth[cuff], before[cuff])


def test_less_skin_is_in_sight_after_clearing(body: Body, monkeypatch: pytest.MonkeyPatch) -> None:
    """All vertices of a tight shirt may be off the skin while its faces cut through shoulders and elbows."""
    mesh = fit_template("shirt", body).mesh
    clearing, exposure = OutfitClearing.of(body, [mesh]), Exposure(body, [mesh])
    tight = mesh.vertices - 0.03 * vertex_normals(mesh.vertices, mesh.faces)
    covered = clearing.cleared([tight], body.mesh.vertices)
    monkeypatch.setattr(Clearing, "cover", lambda *_: None)
    uncovered = clearing.cleared([tight], body.mesh.vertices)
    percents = [exposure.percent(each, body.mesh.vertices) for each in (covered, uncovered)]
    assert percents[0] < 0.4 * percents[1], percents
