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


def _sections(
    ball: tuple[Floats, NDArray], touches: tuple[int, ...], thickness: float = 0.0
) -> dict[str, NDArray]:
    """Grids over each other, each over all those beneath it, by the parts of the body that they touch."""
    points, faces = _grid(41, 0.4)
    count, size = len(touches), len(points)
    outer, inner = np.nonzero(np.tril(np.ones((count, count)), -1))
    return {
        "collider.rest": ball[0],
        "collider.faces": ball[1],
        "collider.starts": np.array([0, len(ball[1])]),
        "fine.rest": np.tile(points, (count, 1)),
        "fine.faces": np.concatenate([faces + size * garment for garment in range(count)]),
        "fine.touches": np.ones(count * size, np.int32),
        "fine.thickness": np.full(count * size, thickness),
        "skin.rest": ball[0],
        "skin.faces": ball[1],
        "covered.corners": np.zeros((0, 3), np.int32),
        "covered.weights": np.zeros((0, 3)),
        "garments.starts": size * np.arange(count + 1),
        "layers.outer": outer,
        "layers.inner": inner,
        "layers.touches": np.repeat(touches, size),
    }


def _over(ball: tuple[Floats, NDArray], thickness: float = 0.0) -> Clearing:
    """A grid on other cloth over a ball."""
    return Clearing(_sections(ball, (1,), thickness))


def _lifted(clearing: Clearing, heights: tuple[Floats | float, ...], turns: int = 1) -> Floats:
    """Heights (G, 41, 41) m of grids after they are lifted off each other."""
    cloth = np.tile(_grid(41, 0.4)[0], (len(heights), 1))
    cloth[:, 2] = np.concatenate([np.broadcast_to(height, (41, 41)).ravel() for height in heights])
    clearing.lift(cloth, CLEARANCE, turns)
    return cloth[:, 2].reshape(-1, 41, 41)


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


def test_outer_garments_are_lifted_off_those_beneath_where_these_lie_by_then(
    ball: tuple[Floats, NDArray],
) -> None:
    heights = _lifted(Clearing(_sections(ball, (1, 1, 1))), (0.0, -0.004, 0.001))
    np.testing.assert_allclose(heights[0], 0.0, atol=0.0)
    np.testing.assert_allclose(heights[1], CLEARANCE, atol=1e-7)
    np.testing.assert_allclose(heights[2], 2 * CLEARANCE, atol=1e-7)


def test_neighbours_of_what_is_lifted_follow_before_the_last_turn(ball: tuple[Floats, NDArray]) -> None:
    sunk = np.full((41, 41), 0.01, np.float32)
    sunk[20, 20] = -0.01
    once, twice = (_lifted(Clearing(_sections(ball, (1, 1))), (0.0, sunk), turns)[1] for turns in (1, 2))
    assert once[20, 20] == pytest.approx(CLEARANCE, abs=1e-6)
    assert (once[20, 19], once[0, 0]) == (np.float32(0.01), np.float32(0.01))
    assert twice[20, 19] > 0.0105
    assert twice[0, 0] == np.float32(0.01)


@pytest.mark.parametrize(
    ("height", "touches"),
    [(-0.031, (1, 1)), (0.0031, (1, 1)), (-0.004, (1, 2))],
    ids=["deeper than the reach", "far enough off", "of other parts of the body"],
)
def test_a_garment_stays_where_no_layer_lifts_it(
    ball: tuple[Floats, NDArray], height: float, touches: tuple[int, int]
) -> None:
    heights = _lifted(Clearing(_sections(ball, touches)), (0.0, height))
    np.testing.assert_array_equal(heights[1], np.float32(height))


def test_points_beside_the_hem_of_a_layer_stay(ball: tuple[Floats, NDArray]) -> None:
    clearing, points = Clearing(_sections(ball, (1, 1))), _grid(41, 0.4)[0]
    beside = points + np.array([0.01, 0.0, -0.005], np.float32)
    cloth = np.concatenate([points, beside])
    clearing.lift(cloth, CLEARANCE, 1)
    lifted = cloth[1681:, 2].reshape(41, 41)
    np.testing.assert_array_equal(lifted[:, -1], np.float32(-0.005))
    np.testing.assert_allclose(lifted[:, :-1], CLEARANCE, atol=1e-6)


def test_layers_out_of_order_are_refused(ball: tuple[Floats, NDArray]) -> None:
    good = _sections(ball, (1, 1))
    with pytest.raises(ValueError, match="not in order"):
        Clearing(good | {"layers.outer": np.array([0]), "layers.inner": np.array([1])})
    with pytest.raises(ValueError, match="mixes garments"):
        Clearing(good | {"garments.starts": np.array([0, 1000, 3362])})


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
        Clearing({})
