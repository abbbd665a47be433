"""Two spheres around a body show what comes through, and inner points are pressed beneath the outer one."""

import pytest
import torch
import trimesh
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.geometry.mesh import Mesh
from uvcloth.physics.cloth_exposure import ClothExposure
from uvcloth.physics.pressing import BENEATH, Pressing
from uvcloth.physics.shell import Shell
from uvcloth.physics.visibility import VisibilityTest

SMALL, LARGE = 1.5, 1.51


def ball(radius: float) -> Mesh:
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    none = torch.zeros(0, 2)
    return Mesh(torch.tensor(sphere.vertices).float(), torch.tensor(sphere.faces), none, none.long())


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


def grown(mesh: Mesh, share: float, metres: float) -> Tensor:
    """Vertices of a ball, those in its top share (of the height) moved outwards."""
    heights = mesh.vertices[:, 2]
    top = heights > heights.max() - share * (heights.max() - heights.min())
    return mesh.vertices + metres * top[:, None] * torch.nn.functional.normalize(mesh.vertices, dim=1)


def test_the_share_is_that_of_the_visible_cloth_that_comes_through(body: Body) -> None:
    inner, outer = ball(SMALL), ball(LARGE)
    exposure = ClothExposure(body, [inner, outer])
    garments = [inner.vertices, outer.vertices]
    assert exposure.percent(garments, body.mesh.vertices) == 0.0
    # A cap's share of the area of a sphere is that of its height.
    through = [grown(inner, 0.2, 0.02), outer.vertices]
    assert exposure.percent(through, body.mesh.vertices) == pytest.approx(20.0, abs=1.5)
    assert ClothExposure(body, [inner]).percent([through[0]], body.mesh.vertices) == 0.0


def test_layers_that_cross_at_rest_are_not_taken_as_right(body: Body) -> None:
    inner, outer = ball(LARGE), ball(SMALL)
    percent = ClothExposure(body, [inner, outer]).percent(
        [inner.vertices, outer.vertices], body.mesh.vertices
    )
    assert percent == pytest.approx(100.0, abs=1.0)


def test_points_that_come_through_are_pressed_beneath_and_no_others_move(body: Body) -> None:
    inner, outer = ball(SMALL), ball(LARGE)
    before = grown(inner, 0.2, 0.015)
    pressed, over = Pressing.of([inner, outer]).pressed([before, outer.vertices])
    assert torch.equal(over, outer.vertices)
    top = before.norm(dim=1) > LARGE
    assert torch.equal(pressed[~top], before[~top])
    assert float(pressed[top].norm(dim=1).max()) < LARGE
    assert float(pressed[top].norm(dim=1).min()) > LARGE - 5 * BENEATH
    lost = grown(inner, 0.2, LARGE - SMALL + 0.018)
    assert torch.equal(Pressing.of([inner, outer]).pressed([lost, outer.vertices])[0], lost)


def test_an_onlooker_sees_the_outer_side_and_not_what_is_inside() -> None:
    mesh = ball(0.5)
    onlooker = VisibilityTest([Shell(mesh.vertices, mesh.faces)])
    points = torch.tensor([[0.51, 0.0, 0.0], [0.0, 0.0, 0.51], [0.3, 0.0, 0.0]])
    assert onlooker.sees(points).tolist() == [True, True, False]
