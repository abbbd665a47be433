"""Cloth meets things as physics says: it is pushed, sticks and slides."""

from dataclasses import replace
from typing import Any

import pytest
import torch
import trimesh

from tests.simulation.physics.experiments import slide
from tests.simulation.physics.scenes import FPS, play, scene, sheet

CREPT = 0.015
"""Metres a second that friction may creep which is regularized: it fades with speed instead of sticking."""


def test_a_ball_that_is_thrown_at_a_sheet_pushes_it(engine: Any) -> None:
    """At 3 m/s from below, through where the sheet was: no vertex ends inside, and none is left behind."""
    rest, faces = sheet(0.4, 0.4, 21, 21)
    ball = trimesh.creation.icosphere(3, radius=0.08)
    ball.apply_translation([0.2, 0.2, -0.1])
    made = scene(rest, faces, 0.4, obstacles=[ball])
    rise = 3.0 / FPS * torch.arange(len(made.collider))
    lift = torch.stack([torch.zeros_like(rise), torch.zeros_like(rise), rise], dim=1)
    moved = play(engine, replace(made, collider=made.collider + lift[:, None]))
    centres = torch.tensor([0.2, 0.2, -0.1]) + lift
    depth = 0.08 - (moved - centres[:, None]).norm(dim=-1)
    assert depth.max() < 1e-3
    on_top = moved[-1, (rest[:, :2] - 0.2).norm(dim=1) < 0.03]
    assert (on_top[:, 2] > centres[-1, 2]).all()


@pytest.mark.cannot(
    "blender", "371 mm at -2 degrees here, unexplained: test_blender.py's incline of 20 holds"
)
def test_a_sheet_slides_from_the_angle_of_its_friction_on(engine: Any) -> None:
    """Two degrees below it creeps at most; two degrees above it gets away, several times as far and faster.

    A rigid sheet would slide 46 mm in the first half second and 138 mm in the next.
    """
    below, above = sum(slide(engine, -2.0)), slide(engine, 2.0)
    assert below < CREPT
    assert sum(above) > 4.0 * below
    assert above[1] > 1.3 * above[0]
