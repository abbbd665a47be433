"""Cloth meets things as physics says: it is pushed, sticks and slides."""

import math

import pytest
import torch
import trimesh

from tests.simulate.physics.scenes import FPS, G, play, scene, sheet, turned_about_y
from uvcloth.simulate.fabric import Fabric

newton = pytest.importorskip("uvcloth.simulate.newton", reason="the `simulate` extra is not installed")
pytest.importorskip("newton", reason="the `simulate` extra is not installed")


def test_a_ball_that_is_thrown_at_a_sheet_pushes_it() -> None:
    """At 3 m/s from below, through where the sheet was: no vertex ends inside, and none is left behind."""
    vertices, faces = sheet(0.4, 0.4, 21, 21)
    ball = trimesh.creation.icosphere(3, radius=0.08)
    ball.apply_translation([0.2, 0.2, -0.1])
    made = scene(vertices, faces, 0.4, obstacles=[ball])
    rise = 3.0 / FPS * torch.arange(len(made.collider))
    lift = torch.stack([torch.zeros_like(rise), torch.zeros_like(rise), rise], dim=1)
    moved = play(newton.Newton(), type(made)(**{**made.__dict__, "collider": made.collider + lift[:, None]}))
    centres = torch.tensor([0.2, 0.2, -0.1]) + lift
    depth = 0.08 - (moved - centres[:, None]).norm(dim=-1)
    assert depth.max() < 1e-3
    on_top = moved[-1, (vertices[:, :2] - 0.2).norm(dim=1) < 0.03]
    assert (on_top[:, 2] > centres[-1, 2]).all()


@pytest.mark.parametrize(("beside", "slides"), [(-2.0, False), (2.0, True)])
def test_a_sheet_slides_from_the_angle_of_its_friction_on(beside: float, slides: bool) -> None:
    fabric = Fabric()
    degrees = math.degrees(math.atan(fabric.friction)) + beside
    vertices, faces = sheet(0.1, 0.1, 7, 7)
    board = trimesh.creation.box([3.0, 1.0, 0.1])
    board.apply_translation([0.0, 0.0, -0.05 - 0.004])
    board.vertices = turned_about_y(torch.from_numpy(board.vertices).float(), degrees).numpy()
    made = scene(turned_about_y(vertices, degrees), faces, 1.5, obstacles=[board])
    moved = play(newton.Newton(fabric=fabric), made).mean(1)
    settled = round(0.5 * FPS)
    way = float((moved[-1] - moved[settled]).norm())
    if slides:
        angle = math.radians(degrees)
        pull = G * (math.sin(angle) - fabric.friction * math.cos(angle))
        assert way == pytest.approx(0.5 * pull * (1.5**2 - 0.5**2), rel=0.35)
    else:
        assert way < 0.003
