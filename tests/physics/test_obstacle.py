"""Nearest skin beside analytic bodies (limbs that cross) and on the default body."""

import pytest
import torch
import trimesh
from torch import Tensor

from uvcloth.bodies.body import load_body
from uvcloth.bodies.collider import Collider, make_collider
from uvcloth.bodies.opened import make_opening
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.motion.library import load_clip
from uvcloth.physics.layers import Layer
from uvcloth.physics.obstacle import SKIN_SEARCH_DISTANCE, ContactGarment, Obstacle
from uvcloth.physics.surface import BodySurface

NEAR = 0.03
"""Metres from the skin within which distances are exact here."""


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


def dressed(vertices: Tensor, parts: int = 1) -> ContactGarment:
    """A garment whose vertices touch the parts with those bits."""
    return ContactGarment(torch.full((len(vertices),), parts, dtype=torch.int32))


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


def test_a_limb_is_met_by_cloth_that_may_touch_it_alone() -> None:
    limbs = obstacle(ellipsoid(0.1, 0.1, 0.5), ellipsoid(0.5, 0.1, 0.1))
    vertices, _ = tube(0.105)
    assert int(limbs.skin(vertices, dressed(vertices, parts=1)).inside.sum()) == 0
    assert int(limbs.skin(vertices, dressed(vertices, parts=3)).inside.sum()) > 100


def test_cloth_between_two_limbs_that_leave_it_no_room_is_squeezed() -> None:
    """Two blocks overlap by 10 mm; the sheet is 4 mm inside one and 6 mm inside the other."""
    below, above = trimesh.creation.box((0.4, 0.4, 0.1)), trimesh.creation.box((0.4, 0.4, 0.1))
    below.apply_translation([0, 0, -0.044])
    above.apply_translation([0, 0, 0.046])
    x, y = torch.meshgrid(*[torch.linspace(-0.15, 0.15, 31)] * 2, indexing="ij")
    sheet = torch.stack([x.flatten(), y.flatten(), torch.full((31 * 31,), 0.002)], dim=1)
    both = obstacle(below, above)
    between = both.skin(sheet, dressed(sheet, parts=3))
    assert between.squeezed.all()
    assert not between.inside.any()
    below_alone = both.skin(sheet, dressed(sheet, parts=1))
    assert below_alone.inside.all()
    assert not below_alone.squeezed.any()


def test_what_is_worn_over_a_layer_is_outside_of_it_at_rest_or_on_its_wrong_side() -> None:
    body = load_body()
    worn = Obstacle(make_collider(body), body.mesh.vertices)
    tops, bottoms = (fit_template(name, body).mesh for name in ("tops", "bottoms"))
    layer = Layer(bottoms.vertices, bottoms.faces)
    (shirt,) = worn.contact_garment(tops.vertices, [layer]).over
    rows, distance, _ = shirt.find(tops.vertices)
    assert len(rows) > 100
    assert distance.min() > 0
    (tucked,) = worn.contact_garment(bottoms.vertices, [Layer(tops.vertices, tops.faces)]).over
    rows, distance, _ = tucked.find(bottoms.vertices)
    assert len(rows) > 100
    assert distance.min() < 0


def test_percent_inside_follows_the_body() -> None:
    body = load_body()
    worn = Obstacle(make_collider(body), body.mesh.vertices)
    mesh = fit_template("tops", body).mesh
    frames = mesh.vertices.expand(2, -1, -1)
    apart = torch.stack([body.mesh.vertices, body.mesh.vertices + torch.tensor([0.0, 0.05, 0.0])])
    garment = worn.contact_garment(mesh.vertices)
    percent = worn.inside_percent(frames, garment, apart)
    assert percent[0] == 0
    assert percent[1] > 20
    assert worn.inside_percent(frames[:0], garment, apart[:0]).shape == (0,)


@pytest.mark.parametrize("name", ["walk", "jump"])
def test_a_search_near_the_skin_finds_what_a_full_one_of_each_part_finds(name: str) -> None:
    """The dress, smoothly skinned and carried 3 cm into the body, beside one closest point query per part."""
    body = load_body()
    dress = fit_template("dress", body)
    collider = make_collider(body)
    parts = [BodySurface(collider.vertices(body.mesh.vertices), faces) for faces in collider.parts]
    worn, opening = Obstacle(collider, body.mesh.vertices), make_opening(collider, body.mesh.vertices)
    garment = worn.contact_garment(dress.mesh.vertices)
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
        for exact in (NEAR, SKIN_SEARCH_DISTANCE):
            distance = worn.skin(vertices, garment, exact=exact).distance
            known = nearest < exact
            assert torch.equal(distance < exact, known)
            torch.testing.assert_close(distance[known], nearest[known], atol=1e-6, rtol=0)
            assert (distance[~known] <= nearest[~known] + 1e-6).all()
        assert 100 < int((nearest < 0).sum()) < int((nearest < NEAR).sum()) < len(vertices) - 100
