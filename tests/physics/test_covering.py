"""Cloth that lies beneath skin in sight is moved over it."""

import pytest
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh, join_meshes, vertex_normals
from uvcloth.physics.covering import OVER, Covering
from uvcloth.physics.exposure import Exposure
from uvcloth.physics.outfit_clearing import OutfitClearing

SUNK = 0.025


def nobody_follows(positions: Tensor, moves: Tensor) -> None:
    """Leave the neighbours where they are."""


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
    covering, cloth = Covering.of(body, join_meshes([(mesh.vertices, mesh.faces)])), vertices.clone()
    shown = covering.exposure.percent([cloth], body.mesh.vertices)
    assert shown > 1.0
    covering.cover(cloth, body.mesh.vertices, nobody_follows)
    assert covering.exposure.percent([cloth], body.mesh.vertices) < 0.1 * shown
    ways = (cloth - vertices).norm(dim=1)
    assert 0.0 < ways.max() < 2.0 * (SUNK + OVER)
    beside = torch.zeros_like(dent)
    beside[mesh.faces[dent[mesh.faces].any(1)]] = True
    assert torch.equal(cloth[~beside], vertices[~beside])


def test_cloth_over_the_skin_keeps_its_bits(body: Body) -> None:
    mesh = fit_template("dress", body).mesh
    covering, cloth = Covering.of(body, join_meshes([(mesh.vertices, mesh.faces)])), mesh.vertices.clone()
    assert len(covering.exposure.covered.corners) > 1000
    covering.cover(cloth, body.mesh.vertices, nobody_follows)
    assert torch.equal(cloth, mesh.vertices)


def test_cloth_of_another_limb_is_left_where_it_is(body: Body) -> None:
    """A sleeve inside the chest, as an arm takes it there, is not put over it."""
    mesh = fit_template("shirt", body).mesh
    covering, cloth = Covering.of(body, join_meshes([(mesh.vertices, mesh.faces)])), mesh.vertices.clone()
    cuff, trunk = cloth[:, 0] > cloth[:, 0].max() - 0.06, cloth[:, 0].abs() < 0.12
    cloth[cuff] += torch.tensor([-0.05, -0.08, 0.62]) - cloth[cuff].mean(0)
    cloth[trunk] += torch.tensor([0.0, 0.3, 0.0])
    before = cloth.clone()
    assert len(covering.exposure.shown([cloth], body.mesh.vertices).rows)
    covering.cover(cloth, body.mesh.vertices, nobody_follows)
    assert torch.equal(cloth[cuff], before[cuff])


def test_less_skin_is_in_sight_after_clearing(body: Body, monkeypatch: pytest.MonkeyPatch) -> None:
    """All vertices of a tight shirt may be off the skin while its faces cut through shoulders and elbows."""
    mesh = fit_template("shirt", body).mesh
    clearing, exposure = OutfitClearing.of(body, [mesh]), Exposure(body, [mesh])
    tight = mesh.vertices - 0.03 * vertex_normals(mesh.vertices, mesh.faces)
    covered = clearing.cleared([tight], body.mesh.vertices)
    monkeypatch.setattr(Covering, "cover", lambda *_: None)
    uncovered = clearing.cleared([tight], body.mesh.vertices)
    percents = [exposure.percent(each, body.mesh.vertices) for each in (covered, uncovered)]
    assert percents[0] < 0.4 * percents[1], percents
