"""Contact against analytic bodies (a sphere, limbs that cross) and on the default body."""

from dataclasses import replace

import pytest
import torch
import trimesh
from torch import Tensor

from uvcloth.bodies.body import load_body
from uvcloth.bodies.collider import Collider, make_collider
from uvcloth.bodies.opened import make_opening
from uvcloth.garments.templates import TEMPLATES, fit_template
from uvcloth.geometry.mesh import unique_edges
from uvcloth.geometry.skinning import skin
from uvcloth.motion.library import load_clip
from uvcloth.physics.contact import (
    FINAL_CLEARANCE,
    LAYER_CLEARANCE,
    PLANE_DISTANCE,
    SKIN_CLEARANCE,
    SKIN_SEARCH_DISTANCE,
    ContactGarment,
    InnerLayerContact,
    Obstacle,
)
from uvcloth.physics.layers import Layer
from uvcloth.physics.strain_limiter import STRETCH, StrainLimiter
from uvcloth.physics.surface import BodySurface


def tensors(mesh: trimesh.Trimesh) -> tuple[Tensor, Tensor]:
    return torch.tensor(mesh.vertices, dtype=torch.float32), torch.tensor(mesh.faces, dtype=torch.int64)


def obstacle(*meshes: trimesh.Trimesh) -> Obstacle:
    """A body whose parts are the meshes."""
    vertices, faces = tensors(trimesh.util.concatenate(meshes))
    return Obstacle(Collider(faces.split([len(mesh.faces) for mesh in meshes]), ()), vertices)


def ellipsoid(*axes: float) -> trimesh.Trimesh:
    shape = trimesh.creation.icosphere(5)
    shape.apply_scale(axes)
    return shape


def dressed(vertices: Tensor, faces: Tensor, parts: int = 1) -> ContactGarment:
    """A garment whose vertices touch the parts with those bits."""
    return ContactGarment(
        StrainLimiter(vertices, faces), torch.full((len(vertices),), parts, dtype=torch.int32)
    )


def grid(rows: int, columns: int, around: bool = False) -> Tensor:
    """Faces of a grid of vertices, closed around its columns or not."""
    index = torch.arange(rows * columns).view(rows, columns)
    index = torch.cat([index, index[:, :1]], dim=1) if around else index
    a, b, c, d = (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1])
    return torch.cat([torch.stack([i.flatten() for i in t], dim=1) for t in ((a, b, c), (a, c, d))])


def tube(radius: float) -> tuple[Tensor, Tensor]:
    """A sleeve around z, 0.8 m long."""
    angle = torch.linspace(0, 2 * torch.pi, 65)[:-1].expand(41, -1)
    height = torch.linspace(-0.4, 0.4, 41)[:, None].expand(-1, 64)
    vertices = torch.stack([radius * angle.cos(), radius * angle.sin(), height], dim=-1)
    return vertices.reshape(-1, 3), grid(41, 64, around=True)


def lengths(vertices: Tensor, faces: Tensor) -> Tensor:
    edges = unique_edges(faces)
    return (vertices[edges[:, 0]] - vertices[edges[:, 1]]).norm(dim=1)


def test_a_sheet_pushed_into_a_sphere_comes_out_without_tearing() -> None:
    x, y = torch.meshgrid(*[torch.linspace(-0.3, 0.3, 41)] * 2, indexing="ij")
    sheet = torch.stack([x.flatten(), y.flatten(), torch.full((41 * 41,), 0.28)], dim=1)
    faces = grid(41, 41)
    resolved, contacts = obstacle(ellipsoid(0.3, 0.3, 0.3)).resolve(sheet, dressed(sheet, faces))
    assert contacts.inside_before > 50
    assert (contacts.inside_after, contacts.squeezed, contacts.deepest) == (0, 0, 0.0)
    assert resolved.norm(dim=1).min() > 0.3 - 1e-4
    ratio = lengths(resolved, faces) / lengths(sheet, faces)
    assert ratio.max() < 1.1
    assert ratio.min() > 0.9


def test_what_is_clear_of_the_body_and_at_rest_length_stays_where_it_is() -> None:
    vertices, faces = tube(0.12)
    resolved, contacts = obstacle(ellipsoid(0.1, 0.1, 0.5)).resolve(vertices, dressed(vertices, faces))
    assert contacts.inside_before == 0
    torch.testing.assert_close(resolved, vertices, atol=1e-5, rtol=0)


def test_stretched_cloth_gets_its_edges_back() -> None:
    rest, faces = tube(0.12)
    noise = 0.004 * torch.randn(rest.shape, generator=torch.manual_seed(0))
    resolved, _ = obstacle(ellipsoid(0.1, 0.1, 0.5)).resolve(rest + noise, dressed(rest, faces))
    wrong, left = ((lengths(v, faces) - lengths(rest, faces)).abs().mean() for v in (rest + noise, resolved))
    assert left < 0.1 * wrong


def test_what_one_frame_moved_helps_the_next() -> None:
    rest, faces = tube(0.12)
    limb, worn = obstacle(ellipsoid(0.1, 0.1, 0.5)), dressed(rest, faces)
    noise = 0.004 * torch.randn(rest.shape, generator=torch.manual_seed(0))
    stretched = rest * torch.tensor([1.0, 1.0, 1.1]) + noise
    allowed = lengths(stretched, faces).clamp(lengths(rest, faces), STRETCH * lengths(rest, faces))
    move, wrong = None, []
    for _ in range(6):
        resolved, _ = limb.resolve(stretched, worn, move)
        move = resolved - stretched
        wrong.append(float((lengths(resolved, faces) - allowed).abs().mean()))
    assert wrong == sorted(wrong, reverse=True)
    assert wrong[-1] < 0.75 * wrong[0]


def test_cloth_on_the_wrong_side_of_a_limb_comes_back() -> None:
    rest, faces = tube(0.12)
    limb, worn = obstacle(ellipsoid(0.1, 0.1, 0.5)), dressed(rest, faces)
    move = torch.tensor([0.5, 0.0, 0.0]).expand_as(rest)
    for _ in range(60):
        resolved, _ = limb.resolve(rest, worn, move)
        move = resolved - rest
    torch.testing.assert_close(resolved, rest, atol=2e-3, rtol=0)


def test_vertices_at_one_place_stay_together() -> None:
    sheet = trimesh.creation.box((0.4, 0.4, 0.02)).subdivide().subdivide().subdivide()
    sheet.apply_translation([0, 0, 0.29])
    corners = torch.tensor(sheet.triangles.reshape(-1, 3), dtype=torch.float32)
    faces = torch.arange(len(corners)).view(-1, 3)
    resolved, contacts = obstacle(ellipsoid(0.3, 0.3, 0.3)).resolve(corners, dressed(corners, faces))
    assert contacts.inside_before > 0
    _, place = torch.unique(corners, dim=0, return_inverse=True)
    for axis in range(3):
        highest = torch.zeros(int(place.max()) + 1).scatter_reduce(
            0, place, resolved[:, axis], "amax", include_self=False
        )
        torch.testing.assert_close(resolved[:, axis], highest[place], atol=1e-6, rtol=0)


def test_a_limb_moves_only_cloth_that_may_touch_it() -> None:
    limbs = obstacle(ellipsoid(0.1, 0.1, 0.5), ellipsoid(0.5, 0.1, 0.1))
    vertices, faces = tube(0.105)
    resolved, contacts = limbs.resolve(vertices, dressed(vertices, faces, parts=1))
    assert (contacts.inside_before, contacts.squeezed) == (0, 0)
    torch.testing.assert_close(resolved, vertices, atol=1e-4, rtol=0)
    _, contacts = limbs.resolve(vertices, dressed(vertices, faces, parts=3))
    assert contacts.inside_before > 100


def test_cloth_between_two_limbs_that_leave_it_no_room_is_left_calm() -> None:
    """Two blocks overlap by 10 mm; the sheet is 4 mm inside one and 6 mm inside the other."""
    below, above = trimesh.creation.box((0.4, 0.4, 0.1)), trimesh.creation.box((0.4, 0.4, 0.1))
    below.apply_translation([0, 0, -0.044])
    above.apply_translation([0, 0, 0.046])
    x, y = torch.meshgrid(*[torch.linspace(-0.15, 0.15, 31)] * 2, indexing="ij")
    sheet = torch.stack([x.flatten(), y.flatten(), torch.full((31 * 31,), 0.002)], dim=1)
    both = obstacle(below, above)
    resolved, contacts = both.resolve(sheet, dressed(sheet, grid(31, 31), parts=3))
    assert contacts.squeezed == len(sheet)
    assert (contacts.inside_before, contacts.inside_after, contacts.deepest) == (0, 0, 0.0)
    torch.testing.assert_close(resolved, sheet, atol=1e-5, rtol=0)
    resolved, contacts = both.resolve(sheet, dressed(sheet, grid(31, 31), parts=1))
    assert (contacts.inside_before, contacts.squeezed) == (len(sheet), 0)
    torch.testing.assert_close(
        resolved[:, 2], torch.full_like(sheet[:, 2], 0.006 + SKIN_CLEARANCE), atol=1e-4, rtol=0
    )


def test_room_between_two_limbs_has_no_step() -> None:
    """A sheet between two blocks, 3 mm from the lower one, that come closer: it moves no more than they do.

    Where the gap of 4 mm decided whether it was held, it moved by millimetres.
    """
    x, y = torch.meshgrid(*[torch.linspace(-0.15, 0.15, 11)] * 2, indexing="ij")
    sheet = torch.stack([x.flatten(), y.flatten(), torch.full((11 * 11,), 0.003)], dim=1)
    heights = []
    for gap in torch.arange(0.0120, -0.0025, -0.0005).tolist():
        below, above = trimesh.creation.box((0.4, 0.4, 0.1)), trimesh.creation.box((0.4, 0.4, 0.1))
        below.apply_translation([0, 0, -0.05])
        above.apply_translation([0, 0, 0.05 + gap])
        both = obstacle(below, above)
        resolved, _ = both.resolve(sheet, dressed(sheet, grid(11, 11), parts=3))
        heights.append(resolved[5 * 11 + 5, 2])
    moved = torch.stack(heights).diff().abs()
    assert moved.max() < 6e-4
    assert abs(float(heights[0]) - SKIN_CLEARANCE) < 1e-4


def over(garment: ContactGarment, layer: Layer, parts: int = 1) -> ContactGarment:
    """A garment worn over a layer whose faces lie beside the parts with those bits."""
    every = torch.arange(len(garment.touches))
    beside = torch.full((len(layer.faces),), parts, dtype=torch.int32)
    return replace(garment, over=(InnerLayerContact(layer, every, garment.touches, beside),))


def test_what_is_worn_over_another_ends_over_it_where_that_one_lies_now() -> None:
    limb, (vertices, faces) = obstacle(ellipsoid(0.1, 0.1, 0.5)), tube(0.13)
    inner, inner_faces = tube(0.12)
    layer, worn = Layer(inner, inner_faces), dressed(vertices, faces)
    sunk = tube(0.11)[0]
    for aside in (torch.zeros(3), torch.tensor([0.01, 0.0, 0.0])):
        layer.update(inner + aside)
        resolved, _ = limb.resolve(sunk, over(worn, layer))
        found = layer.beside(resolved)
        assert found.covered.float().mean() > 0.9
        distance = found.distance[found.covered]
        assert distance.min() > FINAL_CLEARANCE - 1e-5
        assert distance.median() > 0.9 * LAYER_CLEARANCE
    resolved, _ = limb.resolve(sunk, worn)
    assert layer.beside(resolved).distance.min() < 0


def test_a_sleeve_is_free_of_a_layer_that_lies_beside_other_parts() -> None:
    limb, (vertices, faces) = obstacle(ellipsoid(0.1, 0.1, 0.5)), tube(0.11)
    worn = dressed(vertices, faces)
    layer = Layer(*tube(0.12))
    alone, _ = limb.resolve(vertices, worn)
    assert torch.equal(limb.resolve(vertices, over(worn, layer, parts=2))[0], alone)
    assert not torch.equal(limb.resolve(vertices, over(worn, layer, parts=1))[0], alone)


def test_a_layer_holds_what_is_over_it_at_rest_and_nothing_under_it() -> None:
    body = load_body()
    worn = Obstacle(make_collider(body), body.mesh.vertices)
    tops, bottoms = (fit_template(name, body).mesh for name in ("tops", "bottoms"))
    layer = Layer(bottoms.vertices, bottoms.faces)
    (shirt,) = worn.contact_garment(tops.vertices, tops.faces, [layer]).over
    assert len(shirt.rows) == len(tops.vertices)
    rows, distance, _ = shirt.find(tops.vertices)
    assert len(rows) > 100
    assert distance.min() > 0
    (tucked,) = worn.contact_garment(bottoms.vertices, bottoms.faces, [Layer(tops.vertices, tops.faces)]).over
    rows, _, _ = tucked.find(bottoms.vertices)
    assert not len(rows)


def test_templates_at_rest_on_the_default_body_are_outside_and_stay() -> None:
    body = load_body()
    worn = Obstacle(make_collider(body), body.mesh.vertices)
    for name in TEMPLATES:
        mesh = fit_template(name, body).mesh
        resolved, contacts = worn.resolve(mesh.vertices, worn.contact_garment(mesh.vertices, mesh.faces))
        assert (contacts.inside_before, contacts.inside_after) == (0, 0)
        assert (resolved - mesh.vertices).norm(dim=1).mean() < 2e-4


def test_percent_inside_follows_the_body() -> None:
    body = load_body()
    worn = Obstacle(make_collider(body), body.mesh.vertices)
    mesh = fit_template("tops", body).mesh
    frames = mesh.vertices.expand(2, -1, -1)
    apart = torch.stack([body.mesh.vertices, body.mesh.vertices + torch.tensor([0.0, 0.05, 0.0])])
    percent = worn.inside_percent(frames, worn.contact_garment(mesh.vertices, mesh.faces), apart)
    assert percent[0] == 0
    assert percent[1] > 20


@pytest.mark.parametrize("name", ["walk", "jump"])
def test_a_search_near_the_skin_finds_what_a_full_one_of_each_part_finds(name: str) -> None:
    """The dress, smoothly skinned and carried 3 cm into the body, beside one closest point query per part."""
    body = load_body()
    dress = fit_template("dress", body)
    collider = make_collider(body)
    parts = [BodySurface(collider.vertices(body.mesh.vertices), faces) for faces in collider.parts]
    worn, opening = Obstacle(collider, body.mesh.vertices), make_opening(collider, body.mesh.vertices)
    garment = worn.contact_garment(dress.mesh.vertices, dress.mesh.faces)
    touched = [torch.nonzero((garment.touches >> part) & 1).squeeze(1) for part in range(len(parts))]
    for transforms in load_clip(name, body).transforms()[::9]:
        posed = skin(body.mesh.vertices, body.weights, transforms[None])[0]
        vertices = skin(dress.mesh.vertices, dress.smooth_weights, transforms[None])[0]
        vertices += torch.tensor([0.0, 0.03, 0.0])
        nearest = torch.full((len(vertices),), SKIN_SEARCH_DISTANCE)
        opened = opening.opened(collider.vertices(posed))
        for part, rows in zip(parts, touched, strict=True):
            if len(rows):
                part.update(opened)
                found = part.closest(vertices[rows], SKIN_SEARCH_DISTANCE).signed_distance
                nearest[rows] = torch.minimum(nearest[rows], found)
        worn.update(posed)
        for exact in (PLANE_DISTANCE, SKIN_SEARCH_DISTANCE):
            distance = worn.skin(vertices, garment, exact=exact).distance
            known = nearest < exact
            assert torch.equal(distance < exact, known)
            torch.testing.assert_close(distance[known], nearest[known], atol=1e-6, rtol=0)
            assert (distance[~known] <= nearest[~known] + 1e-6).all()
        assert 100 < int((nearest < 0).sum()) < int((nearest < PLANE_DISTANCE).sum()) < len(vertices) - 100
