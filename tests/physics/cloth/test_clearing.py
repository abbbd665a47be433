"""Clearing: fine meshes are moved off the skin, smoothly."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from uvcloth.physics.cloth.clearing import FineMesh, FineState, clear
from uvcloth.physics.cloth.moving_body import Body, make_body, no_memory

CLEARANCE, REACH = np.float32(0.003), np.float32(0.03)
Floats = NDArray[np.float32]


def _grid(count: int, side: float) -> tuple[Floats, NDArray[np.int32], NDArray[np.int32]]:
    """Flat grid (N, 3), and its rings."""
    steps = np.linspace(-0.5 * side, 0.5 * side, count)
    points = np.stack([*map(np.ravel, np.meshgrid(steps, steps)), np.zeros(count * count)], 1)
    number = np.arange(count * count).reshape(count, count)
    edges = np.concatenate(
        [
            np.stack([number[:-1].ravel(), number[1:].ravel()], 1),
            np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], 1),
        ]
    )
    both = np.concatenate([edges, edges[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    starts = np.searchsorted(both[:, 0], np.arange(count * count + 1)).astype(np.int32)
    return points.astype(np.float32), starts, np.ascontiguousarray(both[:, 1], np.int32)


@pytest.fixture(scope="module")
def ball() -> tuple[Floats, NDArray]:
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=0.2)
    return sphere.vertices.astype(np.float32), sphere.faces


def _cleared(
    ball: tuple[Floats, NDArray], height: float, shift: float = 0.0, thickness: float = 0.0
) -> Floats:
    """A grid at a height over the middle of the ball after it is cleared, both shifted."""
    points, starts, ring = _grid(41, 0.4)
    body: Body = make_body(ball[0], [ball[1]], np.ones((1, len(points)), bool))
    mesh = FineMesh(np.full(len(points), thickness, np.float32), starts, ring)
    moved = (points + np.array([0.0, 0.0, height])).astype(np.float32) + np.float32(shift)
    skin = ball[0] + np.float32(shift)
    before = FineState(moved, skin, no_memory(body), 0)
    return clear(mesh, body, before, skin, moved, CLEARANCE, REACH).positions - np.float32(shift)


@pytest.mark.parametrize("thickness", [0.0, 0.006])
def test_what_is_near_the_skin_is_moved_to_the_clearance(
    ball: tuple[Floats, NDArray], thickness: float
) -> None:
    cleared = _cleared(ball, 0.19, thickness=thickness)
    distance = np.linalg.norm(cleared, axis=1) - 0.2
    assert distance.min() > CLEARANCE + thickness - 0.0008
    assert np.linalg.norm(cleared - _cleared(ball, 0.5), axis=1).max() < 0.4


def test_what_is_far_away_stays_to_the_byte(ball: tuple[Floats, NDArray]) -> None:
    points = _grid(41, 0.4)[0]
    np.testing.assert_array_equal(_cleared(ball, 0.5), points + np.float32([0.0, 0.0, 0.5]))


def test_neighbours_follow_so_that_no_edge_is_left(ball: tuple[Floats, NDArray]) -> None:
    """Where cloth is lifted it is not lifted as a step."""
    heights = _cleared(ball, 0.195)[:, 2].reshape(41, 41)
    assert np.abs(np.diff(heights, axis=0)).max() < 0.004


def test_a_small_change_of_the_cloth_is_a_small_change_after_it(ball: tuple[Floats, NDArray]) -> None:
    before, after = _cleared(ball, 0.19), _cleared(ball, 0.19 + 1e-5)
    assert np.linalg.norm(after - before, axis=1).max() < 5e-5


def test_a_shifted_scene_is_cleared_alike(ball: tuple[Floats, NDArray]) -> None:
    here, there = _cleared(ball, 0.19), _cleared(ball, 0.19, shift=0.5)
    assert np.linalg.norm(there - here, axis=1).max() < 5e-5


def test_what_is_known_of_the_frames_before_changes_nothing_on_a_ball(ball: tuple[Floats, NDArray]) -> None:
    """The grid sinks onto the ball and is followed; of faces that are as close another may count."""
    points, starts, ring = _grid(41, 0.4)
    body = make_body(ball[0], [ball[1]], np.ones((1, len(points)), bool))
    mesh = FineMesh(np.zeros(len(points), np.float32), starts, ring)
    state = FineState(points, ball[0], no_memory(body), 0)
    for frame in range(12):
        height = 0.25 - 0.005 * frame
        lowered = (points + np.array([0.0, 0.0, height])).astype(np.float32)
        state = clear(mesh, body, state, ball[0], lowered, CLEARANCE, REACH)
        np.testing.assert_allclose(state.positions, _cleared(ball, height), atol=2e-5)
    assert (state.near.faces >= 0).sum() > 100
