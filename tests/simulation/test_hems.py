"""Hems that hang in the air, on a body that stands and on one that lies."""

import pytest
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.garments.garment import Garment
from uvcloth.garments.places import hems
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import boundary_edges, weld
from uvcloth.physics.obstacle import Obstacle, Skin
from uvcloth.simulation.hems import unsupported_hem

FPS = 30.0
FRAMES = 36


@pytest.fixture(scope="module")
def dress(body: Body) -> Garment:
    return fit_template("dress", body)


def judge(vertices: Tensor, skinned: Tensor, dress: Garment, body: Body, posed: Tensor) -> tuple | None:
    obstacle = Obstacle(make_collider(body), body.mesh.vertices)
    rest, faces = dress.mesh.vertices, dress.mesh.faces
    garment = obstacle.contact_garment(rest)

    def skin_at(frame: int) -> Skin:
        obstacle.update(posed.expand(len(vertices), -1, -1)[frame])
        return obstacle.skin(vertices[frame], garment)

    return unsupported_hem(vertices, skinned, rest, faces, FPS, skin_at)


def lifted(dress: Garment, rise: Tensor) -> Tensor:
    """The dress at rest with its lowest hem higher by rise (F,) m, the skirt shorter in proportion."""
    rest = dress.mesh.vertices
    low, waist = rest[:, 2].min(), rest[:, 2].median()
    share = ((waist - rest[:, 2]) / (waist - low)).clamp(min=0.0)
    moved = rest.repeat(len(rise), 1, 1)
    moved[..., 2] += rise[:, None] * share
    return moved


def test_a_dress_has_four_hems_and_seams_are_none(dress: Garment) -> None:
    found = hems(boundary_edges(weld(dress.mesh.vertices)[dress.mesh.faces]))
    assert len(found) == 4
    lowest = min(found, key=lambda hem: float(dress.mesh.vertices[hem, 2].mean()))
    assert float(dress.mesh.vertices[lowest, 2].max()) < float(dress.mesh.vertices[:, 2].min()) + 0.05
    corners = torch.arange(3).view(1, 3)
    assert [len(hem) for hem in hems(boundary_edges(corners))] == [3]


def test_a_skirt_that_stays_up_is_found_and_one_that_comes_down_or_swings_is_not(
    dress: Garment, body: Body
) -> None:
    time = torch.arange(FRAMES)
    skinned = dress.mesh.vertices.expand(FRAMES, -1, -1)

    def found(rise: Tensor) -> tuple | None:
        return judge(lifted(dress, rise), skinned, dress, body, body.mesh.vertices[None])

    stays = found(torch.where(time < 3, 0.0, 0.3))
    assert stays is not None
    assert stays[0] == 4
    assert stays[1] == pytest.approx(0.3, abs=0.03)
    assert found(torch.where(time < 29, 0.3, 0.0)) is None
    assert found(torch.where(time == 15, 0.0, 0.3)) is None
    assert found(torch.full((FRAMES,), 0.08)) is None
    swings = lifted(dress, torch.full((FRAMES,), 0.3))
    swings[..., 0] += 0.06 * (-1.0) ** time[:, None] * (dress.mesh.vertices[:, 2] < -0.1)
    assert judge(swings, skinned, dress, body, body.mesh.vertices[None]) is None


def test_a_skirt_that_lies_on_the_thighs_is_supported(dress: Garment, body: Body) -> None:
    """A body on its back, the skirt a centimetre off its skin and 15 cm above the skinned one."""
    turn = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    posed, lying = body.mesh.vertices @ turn.T, dress.mesh.vertices @ turn.T
    obstacle = Obstacle(make_collider(body), body.mesh.vertices)
    worn = obstacle.contact_garment(dress.mesh.vertices)
    obstacle.update(posed)
    skin = obstacle.skin(lying.contiguous(), worn, 0.3)
    lying = lying - ((skin.distance - 0.01) * (skin.distance < 0.3))[:, None] * skin.normals
    vertices = lying.repeat(FRAMES, 1, 1)
    skinned = vertices - torch.tensor([0.0, 0.0, 0.15])
    assert judge(vertices, skinned, dress, body, posed[None]) is None
    afloat = vertices + torch.tensor([0.0, 0.0, 0.5])
    assert judge(afloat, skinned, dress, body, posed[None]) is not None
