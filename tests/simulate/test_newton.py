"""The cloth engine: draping, what may not touch, layers, the same result twice, the start of a substep."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
import trimesh

pytest.importorskip("newton", reason="the `simulate` extra is not installed")

from newton.solvers import SolverVBD

from tests.simulate.physics.scenes import play
from uvcloth.physics.layers import wrong_side_percent
from uvcloth.simulate import newton
from uvcloth.simulate.engine import Scene
from uvcloth.simulate.newton import MAX_SUBSTEPS, Newton

FPS = 30.0

CONVERGED_DROP = 0.0200
"""Metres that the hanging sheet comes down in 80 substeps of 20 iterations, which take minutes."""


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
        mass_factor=torch.ones(len(points)),
        inner_thickness=torch.zeros(len(points)),
        skinned=points.expand(frames, -1, -1),
        collider=surface.expand(frames, -1, -1),
        collider_parts=(torch.from_numpy(ball.faces),),
        touches=torch.ones(1, len(points), dtype=torch.bool),
        fps=FPS,
    )


def hanging_sheet(frames: int) -> Scene:
    """A sheet of 30 x 30 cm that hangs from its upper edge."""
    size = 11
    x, z = torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij")
    points = torch.stack([0.03 * x, torch.zeros_like(x), -0.03 * z], -1).reshape(-1, 3).float()
    corner = (torch.arange(size - 1)[:, None] * size + torch.arange(size - 1)).reshape(-1)
    faces = [[corner, corner + size, corner + size + 1], [corner, corner + size + 1, corner + 1]]
    return Scene(
        rest=points,
        faces=torch.cat([torch.stack(three, 1) for three in faces]),
        band=points[:, 2] == 0,
        mass_factor=torch.ones(len(points)),
        inner_thickness=torch.zeros(len(points)),
        skinned=points.expand(frames, -1, -1),
        collider=torch.zeros(frames, 0, 3),
        collider_parts=(),
        touches=torch.zeros(0, len(points), dtype=torch.bool),
        fps=30.0,
    )


def test_a_sheet_comes_to_lie_on_a_ball_the_same_way_twice(tmp_path: Path) -> None:
    first, second = (play(Newton(), sheet_over_a_ball(frames, height=0.14)) for frames in (20, 10))
    assert torch.equal(first[:10], second)
    assert float(second[-1].norm(dim=1).min()) < 0.125, "no contact in what was compared"
    distance = first[-1].norm(dim=1)
    assert float(distance.min()) > 0.118
    assert float(first[-1, :, 2].max()) > 0.11
    assert float(first[-1, :, 2].min()) < 0.10


def test_it_goes_on_from_any_frame_as_if_it_had_not_stopped() -> None:
    whole = sheet_over_a_ball(10, height=0.13)
    way = torch.arange(10.0)[:, None, None] ** 2 * torch.tensor([0.003, -0.001, 0.002])
    moving = replace(
        whole, skinned=whole.skinned + way, collider=whole.collider + way, band=whole.rest[:, 0] > 0.16
    )
    frames = list(Newton().simulate(moving))
    truth = torch.stack([frame.vertices for frame in frames])
    assert [frame.index for frame in frames] == list(range(10))
    assert float((truth[-1] - truth[0] - way[-1]).norm(dim=1).max()) > 0.02
    for stopped in (5, 9):
        rest = list(Newton().simulate(moving, after=frames[stopped]))
        assert [frame.index for frame in rest] == list(range(stopped + 1, 10))
        if rest:
            assert torch.equal(torch.stack([frame.vertices for frame in rest]), truth[stopped + 1 :])
    still = replace(
        frames[5], memory=(frames[5].memory.view(3, -1) * torch.tensor([[1.0], [0.0], [1.0]])).flatten()
    )
    assert not torch.equal(next(Newton().simulate(moving, after=still)).vertices, truth[6])


def test_what_may_not_touch_does_not_and_fast_scenes_take_more_substeps() -> None:
    scene = sheet_over_a_ball(12, height=0.14)
    apart = replace(scene, touches=torch.zeros_like(scene.touches))
    engine = Newton()
    fallen = play(engine, apart)[-1]
    assert float(fallen[:, 2].max()) < 0.0
    still, fast = torch.zeros(4, 3), torch.full((4, 3), 2.0 * engine.substeps * engine.stride)
    assert engine.substeps_for(still, still) == engine.substeps
    assert engine.substeps_for(still, fast) > 2 * engine.substeps
    assert engine.substeps_for(still, 1e6 * fast) == MAX_SUBSTEPS


def test_layers_keep_apart_and_the_outer_one_farther_off_the_ball() -> None:
    inner, outer = sheet_over_a_ball(20, height=0.135), sheet_over_a_ball(20, height=0.145)
    count = len(inner.rest)
    both = replace(
        inner,
        rest=torch.cat([inner.rest, outer.rest]),
        faces=torch.cat([inner.faces, inner.faces + count]),
        band=inner.band.repeat(2),
        mass_factor=inner.mass_factor.repeat(2),
        inner_thickness=torch.tensor([0.0, 0.006]).repeat_interleave(count),
        skinned=torch.cat([inner.skinned, outer.skinned], dim=1),
        touches=inner.touches.repeat(1, 2),
    )
    below, above = play(Newton(), both).split(count, dim=1)
    assert wrong_side_percent(above, below, inner.faces) == 0.0
    assert float(above[-1].norm(dim=1).min()) > 0.127


def test_newton_starts_substeps_from_free_fall_which_stretches_cloth(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, engine = hanging_sheet(20), Newton(substeps=10, iterations=1)

    def drop() -> float:
        """Metres that the lower edge has come down."""
        return float((scene.rest - play(engine, scene)[-1])[:, 2].max())

    from_acceleration = drop()
    monkeypatch.setattr(newton, "patched_solver", lambda: SolverVBD)
    from_free_fall = drop()
    assert abs(from_acceleration - CONVERGED_DROP) < 0.3 * (from_free_fall - CONVERGED_DROP)
