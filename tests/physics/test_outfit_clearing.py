"""Clearing of outfits: garments off the default body, a small one, and off each other."""

from dataclasses import replace

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.bodies.stature import beside_adults
from uvcloth.garments.templates import TEMPLATES, fit_template
from uvcloth.geometry.mesh import Mesh, weld
from uvcloth.geometry.skinning import skin
from uvcloth.motion.library import load_clip
from uvcloth.physics.layers import Layer, wrong_side_percent
from uvcloth.physics.obstacle import Obstacle
from uvcloth.physics.outfit_clearing import CLEARANCE, FOLLOWING, OutfitClearing


def inside_percent(body: Body, mesh: Mesh, vertices: torch.Tensor, posed: torch.Tensor) -> float:
    obstacle = Obstacle(make_collider(body), body.mesh.vertices)
    garment = obstacle.contact_garment(mesh.vertices)
    return float(obstacle.inside_percent(vertices[None].contiguous(), garment, posed[None]))


def test_templates_at_rest_stay_where_they_are(body: Body) -> None:
    for name in TEMPLATES:
        mesh = fit_template(name, body).mesh
        (cleared,) = OutfitClearing.of(body, [mesh]).cleared([mesh.vertices], body.mesh.vertices)
        assert (cleared - mesh.vertices).norm(dim=1).mean() < 2e-4


@pytest.mark.parametrize("name", ["tops", "dress"])
def test_a_garment_three_centimetres_in_the_body_comes_out_and_no_vertex_jumps_far(
    body: Body, name: str
) -> None:
    garment = fit_template(name, body)
    transforms = load_clip("jump", body).transforms()[40]
    posed = skin(body.mesh.vertices, body.weights, transforms[None])[0]
    sunk = skin(garment.mesh.vertices, garment.smooth_weights, transforms[None])[0]
    sunk += torch.tensor([0.0, 0.03, 0.0])
    (cleared,) = OutfitClearing.of(body, [garment.mesh]).cleared([sunk], posed)
    assert inside_percent(body, garment.mesh, sunk, posed) > 5.0
    assert inside_percent(body, garment.mesh, cleared, posed) < 2.0
    assert (cleared - sunk).norm(dim=1).max() < 0.06


def test_a_frame_does_not_depend_on_those_before(body: Body) -> None:
    garment = fit_template("tops", body)
    clearing = OutfitClearing.of(body, [garment.mesh])
    motion = load_clip("walk", body).transforms()[:20:5]
    posed = skin(body.mesh.vertices, body.weights, motion)
    sunk = 0.97 * skin(garment.mesh.vertices, garment.smooth_weights, motion)
    one_by_one = [clearing.cleared([one], at)[0] for one, at in zip(sunk, posed, strict=True)]
    assert torch.equal(clearing.cleared([sunk[3]], posed[3])[0], one_by_one[3])
    assert not torch.equal(one_by_one[3], sunk[3])


def test_vertices_at_one_place_stay_together(body: Body) -> None:
    mesh = fit_template("tops", body).mesh
    corners = mesh.faces.flatten()
    soup = replace(
        mesh,
        vertices=mesh.vertices[corners],
        faces=torch.arange(len(corners)).view(-1, 3),
    )
    (whole,) = OutfitClearing.of(body, [mesh]).cleared([0.98 * mesh.vertices], body.mesh.vertices)
    (split,) = OutfitClearing.of(body, [soup]).cleared([0.98 * soup.vertices], body.mesh.vertices)
    torch.testing.assert_close(split, whole[corners], atol=1e-6, rtol=0.0)
    assert torch.equal(split, split[weld(soup.vertices)])


def test_a_doll_is_cleared_as_an_adult_is_in_its_size(body: Body) -> None:
    mesh, size = fit_template("tops", body).mesh, 0.2
    doll = replace(
        body,
        mesh=replace(body.mesh, vertices=size * body.mesh.vertices),
        skeleton=replace(body.skeleton, heads=size * body.skeleton.heads),
    )
    sunk = 0.98 * mesh.vertices
    (adult,) = OutfitClearing.of(body, [mesh]).cleared([sunk], body.mesh.vertices)
    small = replace(mesh, vertices=size * mesh.vertices)
    (cleared,) = OutfitClearing.of(doll, [small]).cleared([size * sunk], doll.mesh.vertices)
    lengthened = size / beside_adults(doll)
    assert lengthened != 1.0
    assert (cleared / size - adult).norm(dim=1).mean() < 1e-3
    assert (adult - sunk).norm(dim=1).mean() > 1e-3


def test_an_outer_garment_keeps_off_the_inner_one_where_that_lies_now(body: Body) -> None:
    inner, outer = (fit_template(name, body).mesh for name in ("tops", "jacket"))
    clearing = OutfitClearing.of(body, [inner, outer])
    shrunk = outer.vertices - 0.03 * torch.nn.functional.normalize(outer.vertices, dim=1)
    under, over = clearing.cleared([inner.vertices, shrunk], body.mesh.vertices)
    assert wrong_side_percent(shrunk[None], inner.vertices[None], inner.faces) > 10.0
    assert wrong_side_percent(over[None], under[None], inner.faces) < 0.5
    layer = Layer(under, inner.faces)
    beside = layer.beside(over)
    assert beside.distance[beside.covered].median() > 0.9 * CLEARANCE


def test_garments_that_follow_cages_move_only_where_they_are_too_close(body: Body) -> None:
    inner, outer = (fit_template(name, body).mesh for name in ("tops", "jacket"))
    clearing = OutfitClearing.of(body, [inner, outer])
    shrunk = outer.vertices - 0.01 * torch.nn.functional.normalize(outer.vertices, dim=1)
    collider = clearing.collider(body.mesh.vertices)
    points = [
        vertices[mesh.kept] for vertices, mesh in zip((inner.vertices, shrunk), clearing.meshes, strict=True)
    ]
    _, (under, over) = clearing.clear(points, collider, body.mesh.vertices, clearing.start(), FOLLOWING)
    # What the skin alone asks for, before the layers.
    skinned = torch.cat(points).numpy()
    _, cleared = clearing.fine.clear(clearing.start(), skinned, collider, CLEARANCE, FOLLOWING.reach)
    clearing.fine.cover(cleared, body.mesh.vertices.numpy())
    before = torch.from_numpy(cleared)
    before = before[len(points[0]) :][clearing.meshes[1].places]
    moved = (over - before).norm(dim=1) > 1e-5
    beside = Layer(under, inner.faces).beside(before)
    assert moved.sum() > 20
    assert (beside.covered & (beside.distance < CLEARANCE))[moved].all()
