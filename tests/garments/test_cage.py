"""Cages: coarse meshes of garments that are good to simulate and carry the garment."""

import pytest
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.garments import cage as cages
from uvcloth.garments.cage import AROUND, QUALITIES, Cage, kept_cage, make_cage
from uvcloth.garments.places import hems
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import boundary_edges, edge_lengths, face_normals, unique_edges, weld

EDGE = QUALITIES["default"]


@pytest.fixture(scope="module", params=["dress", "shirt", "jacket"])
def caged(request: pytest.FixtureRequest, body: Body) -> tuple[Tensor, Tensor, Cage]:
    """A template's vertices and faces, and its cage."""
    mesh = fit_template(request.param, body).mesh
    return mesh.vertices, mesh.faces, make_cage(mesh.vertices, mesh.faces, EDGE)


def _rims(faces: Tensor) -> list[Tensor]:
    edges = boundary_edges(faces)
    return [edges[torch.isin(edges, hem).all(1)] for hem in hems(edges)]


def test_a_cage_is_a_sheet_with_the_hems_of_its_garment(caged: tuple[Tensor, Tensor, Cage]) -> None:
    vertices, faces, cage = caged
    directed = torch.cat([cage.faces[:, [0, 1]], cage.faces[:, [1, 2]], cage.faces[:, [2, 0]]])
    assert len(directed.unique(dim=0)) == len(directed)
    rims, expected = _rims(cage.faces), _rims(weld(vertices)[faces])
    around = sorted(float(edge_lengths(cage.vertices, rim).sum()) for rim in rims)
    lengths = sorted(float(edge_lengths(vertices, rim).sum()) for rim in expected)
    assert around == pytest.approx(lengths, rel=0.06)


def test_no_face_is_narrow_since_the_narrowest_decides_the_time_step(
    caged: tuple[Tensor, Tensor, Cage],
) -> None:
    _, _, cage = caged
    corners = cage.vertices[cage.faces]
    longest = (corners - corners.roll(1, 1)).norm(dim=2).amax(1)
    heights = face_normals(cage.vertices, cage.faces).norm(dim=1) / longest
    lengths = edge_lengths(cage.vertices, unique_edges(cage.faces))
    assert float(lengths.mean()) == pytest.approx(EDGE, rel=0.1)
    assert float(heights.min()) > EDGE / 3


def test_faces_of_a_cage_look_outwards_as_those_of_its_garment(caged: tuple[Tensor, Tensor, Cage]) -> None:
    vertices, faces, cage = caged
    there = face_normals(vertices, weld(vertices)[faces])
    nearest = torch.cdist(cage.vertices[cage.faces].mean(1), vertices[faces].mean(1)).argmin(1)
    assert ((face_normals(cage.vertices, cage.faces) * there[nearest]).sum(1) > 0).float().mean() > 0.99


def test_garment_and_cage_carry_each_other(caged: tuple[Tensor, Tensor, Cage]) -> None:
    vertices, _, cage = caged
    torch.testing.assert_close(cage.at_cage(vertices), cage.vertices, atol=1e-5, rtol=0.0)
    assert float((cage.at_garment(cage.vertices) - vertices).norm(dim=1).mean()) < 0.003
    bent = torch.stack([vertices[:, 0] ** 2, vertices[:, 1], 0.5 * vertices[:, 2]], dim=1)
    assert float((cage.at_garment(cage.at_cage(bent)) - bent).norm(dim=1).mean()) < 0.003


def test_narrow_cuffs_have_edges_enough_around(body: Body) -> None:
    mesh = fit_template("shirt", body).mesh
    cage = make_cage(mesh.vertices, mesh.faces, QUALITIES["fast"])
    assert min(map(len, _rims(cage.faces))) >= AROUND // 2


def test_the_same_garment_has_the_same_cage(body: Body) -> None:
    mesh = fit_template("skirt", body).mesh
    first, second = (make_cage(mesh.vertices, mesh.faces, EDGE) for _ in range(2))
    assert first.vertices.equal(second.vertices)
    assert first.faces.equal(second.faces)


def test_the_last_cages_are_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    points, faces = _sheet(0.3, 8, 0.0)
    monkeypatch.setattr(cages, "KEPT", 2)
    monkeypatch.setattr(cages, "make_cage", lambda *_: object())
    first = kept_cage(points, faces, EDGE)
    assert kept_cage(points.clone(), faces, EDGE) is first
    assert kept_cage(2.0 * points, faces, EDGE) is not first
    assert kept_cage(points, faces, EDGE) is first
    for scale in (3.0, 4.0):
        kept_cage(scale * points, faces, EDGE)
    assert kept_cage(points, faces, EDGE) is not first


def _sheet(side: float, count: int, height: float) -> tuple[Tensor, Tensor]:
    steps = torch.linspace(0.0, side, count)
    x, y = torch.meshgrid(steps, steps, indexing="ij")
    points = torch.stack([x.flatten(), y.flatten(), torch.full((count * count,), height)], dim=1)
    first = (torch.arange(count - 1)[:, None] * count + torch.arange(count - 1)).flatten()
    return points, torch.cat(
        [
            torch.stack([first, first + count, first + 1], 1),
            torch.stack([first + 1, first + count, first + count + 1], 1),
        ]
    )


def test_layers_that_lie_on_each_other_have_cages_of_their_own() -> None:
    """A jacket welded over its shirt: cells that are near in space but not along the cloth do not mix."""
    under, faces = _sheet(0.6, 25, 0.0)
    over, _ = _sheet(0.6, 25, 0.0005)
    cage = make_cage(torch.cat([under, over]), torch.cat([faces, faces + len(under)]), EDGE)
    layer = (cage.vertices[:, 2] > 0.00025).long()
    assert (layer[cage.faces] == layer[cage.faces][:, :1]).all()
    assert layer.sum() == pytest.approx(len(layer) / 2, rel=0.1)
    carried = layer[cage.own_corners]
    assert not carried[: len(under)].any()
    assert carried[len(under) :].all()


def test_buttons_follow_the_cloth_around_them() -> None:
    cloth, faces = _sheet(0.6, 25, 0.0)
    button, own = _sheet(0.015, 4, 0.002)
    cage = make_cage(torch.cat([cloth, button + 0.3]), torch.cat([faces, own + len(cloth)]), EDGE)
    assert float(cage.vertices[:, 2].max()) < 0.001
    shifted = cage.at_garment(torch.tensor([0.0, 0.0, 1.0]).expand(len(cage.vertices), 3))
    torch.testing.assert_close(shifted[len(cloth) :, 2], torch.ones(len(button)), atol=1e-5, rtol=0.0)


def test_a_strap_gets_smaller_faces() -> None:
    strap, faces = _sheet(0.1, 12, 0.0)
    cage = make_cage(strap * torch.tensor([1.0, 5.0, 1.0]), faces, EDGE)
    assert len(cage.vertices) > 40
    assert torch.isfinite(cage.vertices).all()
