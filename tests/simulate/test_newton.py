"""The cloth engine: free fall, draping, and the same result twice."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
import trimesh

pytest.importorskip("newton", reason="the `simulate` extra is not installed")

from uvcloth.physics.layers import wrong_side_percent
from uvcloth.simulate.engine import Scene
from uvcloth.simulate.newton import Style3D

FPS = 30.0

ENGINE_DAMPING = 0.998
"""SolverStyle3D itself keeps this share of the velocity in every substep."""


def sheet_over_a_ball(frames: int, height: float) -> Scene:
    size = 12
    grid = torch.stack(torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij"), -1).reshape(
        -1, 2
    )
    points = torch.cat([(grid - (size - 1) / 2) * 0.03, torch.full((size * size, 1), height)], dim=1)
    corner = (torch.arange(size - 1)[:, None] * size + torch.arange(size - 1)).reshape(-1)
    faces = torch.cat(
        [
            torch.stack([corner, corner + size, corner + size + 1], 1),
            torch.stack([corner, corner + size + 1, corner + 1], 1),
        ]
    )
    ball = trimesh.creation.icosphere(3, radius=0.12)
    surface = torch.from_numpy(ball.vertices).float()
    return Scene(
        rest=points,
        faces=faces,
        band=torch.zeros(len(points), dtype=torch.bool),
        heavier=torch.ones(len(points)),
        room=torch.zeros(len(points)),
        carrier=points.expand(frames, -1, -1),
        collider=surface.expand(frames, -1, -1),
        collider_parts=(torch.from_numpy(ball.faces),),
        touches=torch.ones(1, len(points), dtype=torch.bool),
        fps=FPS,
    )


def test_a_sheet_falls_at_g_without_air() -> None:
    frames = 6
    engine = Style3D(drag=0.0, follow=0.0)
    scene = sheet_over_a_ball(frames, height=3.0)
    heights = torch.stack([vertices[:, 2].mean() for vertices in engine.simulate(scene)])
    step = 1.0 / (FPS * engine.substeps)
    speed, height, expected = 0.0, 3.0, [3.0]
    for _ in range(1, frames):
        for _ in range(engine.substeps):
            moved = (speed - 9.81 * step) * step
            height, speed = height + moved, ENGINE_DAMPING * moved / step
        expected.append(height)
    torch.testing.assert_close(heights, torch.tensor(expected), atol=2e-4, rtol=0)


def test_a_sheet_comes_to_lie_on_a_ball_the_same_way_twice(tmp_path: Path) -> None:
    engine = Style3D()
    scene = sheet_over_a_ball(20, height=0.14)
    first = torch.stack(list(engine.simulate(scene)))
    second = torch.stack(list(engine.simulate(scene)))
    assert torch.equal(first, second)
    distance = first[-1].norm(dim=1)
    assert float(distance.min()) > 0.118
    assert float(first[-1, :, 2].max()) > 0.11
    assert float(first[-1, :, 2].min()) < 0.10


def test_what_may_not_touch_does_not_and_fast_scenes_take_more_substeps() -> None:
    scene = sheet_over_a_ball(12, height=0.14)
    apart = replace(scene, touches=torch.zeros_like(scene.touches))
    engine = Style3D()
    fallen = list(engine.simulate(apart))[-1]
    assert float(fallen[:, 2].max()) < 0.0
    still, moved = scene.carrier[0], scene.carrier[0] + torch.tensor([0.0, 0.0, 0.255])
    assert engine.substeps_between(still, still) == engine.substeps
    assert engine.substeps_between(still, moved) == 26


def test_layers_keep_apart_and_the_outer_one_farther_off_the_ball() -> None:
    inner, outer = sheet_over_a_ball(20, height=0.135), sheet_over_a_ball(20, height=0.145)
    count = len(inner.rest)
    both = replace(
        inner,
        rest=torch.cat([inner.rest, outer.rest]),
        faces=torch.cat([inner.faces, inner.faces + count]),
        band=inner.band.repeat(2),
        heavier=inner.heavier.repeat(2),
        room=torch.tensor([0.0, 0.006]).repeat_interleave(count),
        carrier=torch.cat([inner.carrier, outer.carrier], dim=1),
        touches=inner.touches.repeat(1, 2),
    )
    below, above = torch.stack(list(Style3D().simulate(both))).split(count, dim=1)
    assert wrong_side_percent(above, below, inner.faces) == 0.0
    assert float(above[-1].norm(dim=1).min()) > 0.127
