"""Cloth on cloth and cloth on bodies: sides are kept, nothing crosses, nothing is torn."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from tests.physics.cloth.stepping import crossing, frames, solver, still_frames
from tests.simulation.physics.scenes import disc, sheet
from uvcloth.geometry.mesh import edge_lengths, join_meshes, unique_edges
from uvcloth.physics.cloth.solver import State, start
from uvcloth.physics.layers import wrong_side_percent

FPS = 30.0
RADIUS = 0.004


def box(height: float) -> trimesh.Trimesh:
    """A floor of 1 m whose top is at a height, m."""
    place = trimesh.transformations.translation_matrix([0.0, 0.0, height - 0.1])
    return trimesh.creation.box([1.0, 1.0, 0.2], place)


def moving(things: Sequence[trimesh.Trimesh], ways: Sequence[Tensor]) -> np.ndarray:
    """Vertices (F, V, 3) of things that each go a way (F, 3)."""
    return np.concatenate(
        [thing.vertices[None] + way.numpy()[:, None] for thing, way in zip(things, ways, strict=True)], 1
    )


def test_cloth_that_is_thrown_at_cloth_stays_on_its_side() -> None:
    """A sheet held at its border is met by a small one at 6 m/s, 20 cm a frame."""
    lower, upper = sheet(0.4, 0.4, 21, 21), sheet(0.12, 0.12, 8, 8)
    thrown = upper[0] + torch.tensor([0.143, 0.141, 0.02])
    joined = join_meshes([lower, (thrown, upper[1])])
    rest, faces, count = joined.vertices, joined.faces, len(lower[0])
    border = ((lower[0] < 1e-6) | (lower[0] > 0.4 - 1e-6))[:, :2].any(1)
    held = torch.cat([border, torch.zeros(len(thrown), dtype=torch.bool)])
    made = solver(rest, faces, held=held)
    begin = start(made, rest.numpy())
    speeds = np.zeros_like(begin.velocities)
    speeds[count:, 2] = -6.0
    begin = replace(begin, velocities=speeds)
    states = still_frames(made, begin, rest, 0.3, held=held)
    first = states[0].vertices()
    assert first[count:, 2].mean() < -0.02, "it does not arrive within a frame"
    below, above = (
        torch.stack([torch.from_numpy(s.vertices()[part]).float() for s in states])
        for part in (slice(0, count), slice(count, None))
    )
    assert wrong_side_percent(above, below, lower[1]) == 0.0
    assert crossing(states, faces).max() == 0.0


def test_cloth_that_falls_in_folds_does_not_cross_itself() -> None:
    """A strip of 0.4 m falls on its edge onto a floor, and comes to lie on itself."""
    flat, faces = sheet(0.4, 0.15, 33, 13)
    uneven = 0.001 * torch.randn(len(flat), generator=torch.manual_seed(1))
    rest = torch.stack([uneven, flat[:, 1], flat[:, 0] + 0.01], 1)
    floor = box(0.0)
    made = solver(rest, faces, things=[floor])
    states = still_frames(made, start(made, rest.numpy()), rest, 1.0, things=[floor])
    assert crossing(states, faces).max() == 0.0
    end = states[-1].vertices()
    assert end[:, 2].max() < 0.2, "it still stands"
    assert end[:, 2].min() > RADIUS - 1e-3
    assert len(states[-1].pairs.points) > 100
    assert stretched(states, rest, faces) < 1.2


def test_cloth_that_two_balls_pinch_is_not_torn_and_comes_out_of_both() -> None:
    """They come as near as 2 mm, less than cloth takes, and part again."""
    rest, faces = sheet(0.3, 0.3, 16, 16)
    balls = [trimesh.creation.icosphere(3, radius=0.06) for _ in range(2)]
    time = torch.linspace(0.0, 1.0, 25)
    gap = 0.002 + 0.12 * (2.0 * time - 1.0).abs()
    centres = [
        torch.stack([0.14 + 0 * gap, 0.15 + 0.05 * time, sign * (0.06 + 0.5 * gap)], 1) for sign in (1, -1)
    ]
    held = rest[:, 0] < 1e-6
    made = solver(rest, faces, held=held, things=balls)
    bodies = moving(balls, centres)
    targets = np.repeat(rest.numpy()[None], len(time), 0)
    states = list(frames(made, start(made, rest.numpy()), targets, bodies, FPS, held))
    assert all(np.isfinite(s.positions).all() for s in states)
    assert stretched(states, rest, faces) < 1.5
    for centre in centres:
        assert np.linalg.norm(states[-1].vertices() - centre[-1].numpy(), axis=1).min() > 0.06
    assert crossing(states, faces).max() == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_a_strip_that_is_pressed_into_folds_does_not_stay_in_itself(seed: int) -> None:
    """It stands on a floor, with edges of 2 cm, and a lid comes down to 12 mm and rises again.

    Where neighbouring faces are not in contact, sharp folds run through themselves, and three of these strips
    stay so.
    """
    height, gap, count = 0.3, 0.012, 60
    flat, faces = sheet(height, 0.12, 16, 7)
    uneven = 0.002 * torch.randn(len(flat), generator=torch.manual_seed(seed))
    rest = torch.stack([uneven, flat[:, 1], flat[:, 0] + 0.006], 1)
    things = [box(0.0), box(height + 0.23)]
    made = solver(rest, faces, things=things)
    time = torch.linspace(0.0, 1.0, count + 1)
    drop = (height + 0.03 - gap) * torch.minimum(time / 0.4, 2.0 * (1.0 - time)).clamp(0.0, 1.0)
    down = drop[:, None] * torch.tensor([0.0, 0.0, -1.0])
    bodies = moving(things, [torch.zeros(count + 1, 3), down])
    targets = np.repeat(rest.numpy()[None], count + 1, 0)
    states = list(frames(made, start(made, rest.numpy()), targets, bodies, FPS))
    assert min(state.vertices()[:, 2].max() for state in states) < 0.015
    share = crossing(states, faces)
    assert share.max() < 2.0
    assert share[-1] == 0.0


def test_an_outer_sheet_on_a_ball_stays_outside_of_an_inner_one() -> None:
    inner, outer = disc(0.16, 8), disc(0.15, 7)
    lifted = outer[0] + torch.tensor([0.003, -0.002, 0.006])
    joined = join_meshes([inner, (lifted, outer[1])])
    rest = joined.vertices + torch.tensor([0.0, 0.0, 0.125])
    ball = trimesh.creation.icosphere(3, radius=0.12)
    made = solver(rest, joined.faces, things=[ball])
    states = still_frames(made, start(made, rest.numpy()), rest, 1.0, things=[ball])
    points = torch.stack([torch.from_numpy(s.vertices()).float() for s in states])
    below, above = points.split([len(inner[0]), len(outer[0])], 1)
    assert wrong_side_percent(above, below, inner[1]) == 0.0
    assert crossing(states, joined.faces).max() == 0.0
    assert points.norm(dim=2).min() > 0.12
    assert points[-1, :, 2].min() < 0.06


@pytest.mark.parametrize("below", [0.25, 0.29, 0.31])
def test_a_ball_at_10_metres_a_second_takes_a_sheet_along(below: float) -> None:
    """A third of a metre a frame, twice the ball's width: it is met in between, wherever it starts.

    Converged (substeps=20000), the sheet's longest edge is stretched to 1.78 times its length.
    """
    rest, faces = sheet(0.4, 0.4, 21, 21)
    ball = trimesh.creation.icosphere(3, radius=0.08)
    made = solver(rest, faces, things=[ball])
    rise = 10.0 / FPS * torch.arange(4)
    centres = torch.stack([0.0 * rise + 0.2, 0.0 * rise + 0.2, rise - below], 1)
    targets = np.repeat(rest.numpy()[None], len(rise), 0)
    states = list(frames(made, start(made, rest.numpy()), targets, moving([ball], [centres]), FPS))
    for state, centre in zip(states, centres[1:], strict=True):
        assert np.linalg.norm(state.vertices() - centre.numpy(), axis=1).min() > 0.08
    middle = (rest[:, :2] - 0.2).norm(dim=1) < 0.03
    assert (states[-1].vertices()[middle, 2] > float(centres[-1, 2])).all()
    assert stretched(states, rest, faces) < 1.2 * 1.78


def test_rods_that_spread_in_a_tight_tube_stretch_it_and_do_not_leave_it() -> None:
    """As legs in a narrow skirt: once contact was weaker than the cloth's tension, and they went through."""
    column = trimesh.creation.cylinder(0.1, 0.15, sections=16).subdivide()
    column.update_faces(abs(column.face_normals[:, 2]) < 0.5)
    column.remove_unreferenced_vertices()
    rest, faces = torch.tensor(column.vertices).float(), torch.tensor(column.faces)
    rods = [trimesh.creation.cylinder(0.04, 0.5, sections=32).subdivide_to_size(0.05) for _ in range(2)]
    made = solver(rest, faces, things=rods)
    way = torch.linspace(0.045, 0.245, 8)[:, None] * torch.tensor([1.0, 0.0, 0.0])
    targets = rest.expand(len(way), -1, -1).numpy()
    *_, end = frames(made, start(made, rest.numpy()), targets, moving(rods, [way, -way]), FPS)
    for axis in (way[-1], -way[-1]):
        away = np.linalg.norm(end.vertices()[:, :2] - axis[:2].numpy(), axis=1)
        assert 0.04 < away.min() < 0.04 + 2 * RADIUS


def stretched(states: Sequence[State], rest: Tensor, faces: Tensor) -> float:
    """The longest edge over its length at rest."""
    edges = unique_edges(faces)
    points = torch.stack([torch.from_numpy(s.vertices()).float() for s in states])
    return float((edge_lengths(points, edges) / edge_lengths(rest, edges)).max())
