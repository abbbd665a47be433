"""Clearing: fine meshes are moved off the skin, smoothly."""

import pickle

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from uvcloth.player.clearing import Clearing

CLEARANCE, REACH = 0.003, 0.03
Floats = NDArray[np.float32]


def _grid(count: int, side: float) -> tuple[Floats, NDArray[np.int64]]:
    """Flat grid (N, 3), and its faces."""
    steps = np.linspace(-0.5 * side, 0.5 * side, count)
    points = np.stack([*map(np.ravel, np.meshgrid(steps, steps)), np.zeros(count * count)], 1)
    number = np.arange(count * count).reshape(count, count)
    a, b, c, d = (
        corner.ravel() for corner in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1])
    )
    return points.astype(np.float32), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def _over(ball: tuple[Floats, NDArray], thickness: float = 0.0) -> Clearing:
    """A grid on other cloth over a ball."""
    points, faces = _grid(41, 0.4)
    return Clearing.of(
        {
            "collider.rest": ball[0],
            "collider.faces": ball[1],
            "collider.starts": np.array([0, len(ball[1])]),
            "cloth.rest": points,
            "cloth.faces": faces,
            "cloth.touches": np.ones(len(points), np.int32),
            "cloth.thickness": np.full(len(points), thickness),
            "skin.rest": ball[0],
            "skin.faces": ball[1],
            "covered.corners": np.zeros((0, 3), np.int32),
            "covered.weights": np.zeros((0, 3)),
        }
    )


@pytest.fixture(scope="module")
def ball() -> tuple[Floats, NDArray]:
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=0.2)
    return sphere.vertices.astype(np.float32), sphere.faces


def _cleared(
    ball: tuple[Floats, NDArray], height: float, shift: float = 0.0, thickness: float = 0.0
) -> Floats:
    """A grid at a height over the middle of the ball after it is cleared, both shifted."""
    moved = (_grid(41, 0.4)[0] + np.array([0.0, 0.0, height])).astype(np.float32) + np.float32(shift)
    clearing = _over(ball, thickness)
    _, cleared = clearing.clear(clearing.begin(), moved, ball[0] + np.float32(shift), CLEARANCE, REACH)
    return cleared - np.float32(shift)


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
    points, clearing = _grid(41, 0.4)[0], _over(ball)
    memory = clearing.begin()
    for frame in range(12):
        height = 0.25 - 0.005 * frame
        lowered = (points + np.array([0.0, 0.0, height])).astype(np.float32)
        memory, cleared = clearing.clear(memory, lowered, ball[0], CLEARANCE, REACH)
        np.testing.assert_allclose(cleared, _cleared(ball, height), atol=2e-5)
        assert memory.frame == frame + 1
    assert np.abs(cleared - lowered).max() > 0.005


def test_a_pickled_clearing_is_the_same(ball: tuple[Floats, NDArray]) -> None:
    clearing = _over(ball)
    again = pickle.loads(pickle.dumps(clearing))
    sunk = _grid(41, 0.4)[0] + np.float32([0.0, 0.0, 0.19])
    both = [
        each.clear(each.begin(), sunk, ball[0], CLEARANCE, REACH)[1].tobytes() for each in (clearing, again)
    ]
    assert both[0] == both[1]


def test_sections_that_do_not_fit_together_are_refused_with_a_sentence() -> None:
    with pytest.raises(ValueError, match=r"no section collider\.rest"):
        Clearing.of({})
    with pytest.raises(ValueError, match="cut or damaged"):
        Clearing(b"UVCLOTH\0" + bytes([1, 0, 0, 0]) + bytes(40))
