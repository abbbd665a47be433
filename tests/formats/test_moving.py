"""Packed points: how near they stay, how far they may go, and what does not fit."""

from pathlib import Path

import numpy as np
import pytest

from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.formats.moving import load_moving, pack, unpack

GRID = np.stack(np.meshgrid(np.arange(6), np.arange(5), indexing="ij"), -1).reshape(-1, 2)
FACES = np.array([[5 * i + j, 5 * i + j + 5, 5 * i + j + 1] for i in range(5) for j in range(4)])
LARGEST_ERROR = 5e-5


def waving(frames: int, spread: float) -> np.ndarray:
    """A sheet of 30 points that waves, wanders off by `spread` metres and trembles by a millimetre."""
    time = np.arange(frames)[:, None] / 30.0
    height = 0.1 * np.sin(3.0 * time + GRID[:, 0])
    sheet = np.stack([np.broadcast_to(0.02 * GRID[:, axis], height.shape) for axis in (0, 1)], -1)
    away = spread * np.linspace(0.0, 1.0, frames)[:, None, None] ** 2
    noise = 0.001 * np.random.default_rng(0).normal(size=(frames, len(GRID), 3))
    return (np.concatenate([sheet, height[..., None]], -1) + away + noise).astype(np.float32)


def error(points: np.ndarray, faces: np.ndarray = FACES) -> float:
    apart = unpack(**pack(points, faces)).astype(np.float64) - points
    return float(np.linalg.norm(apart, axis=-1).max())


@pytest.mark.parametrize(("frames", "spread"), [(1, 0.0), (2, 0.0), (3, 0.1), (2000, 40.0)])
def test_errors_are_bounded_and_do_not_add_up(frames: int, spread: float) -> None:
    points = waving(frames, spread)
    assert 0 < error(points) < LARGEST_ERROR
    assert pack(points, FACES)["changes"].dtype == np.uint8
    again = unpack(**pack(points, FACES))
    assert again.flags["C_CONTIGUOUS"]
    assert np.array_equal(unpack(**pack(again, FACES)), again)


def test_pieces_far_apart_and_points_of_no_face_are_points_like_others() -> None:
    points = np.concatenate([waving(20, 0.5), waving(20, 0.5) + 1.5, waving(20, 0.5)[:, :1] - 1.0], axis=1)
    faces = np.concatenate([FACES, FACES + len(GRID)])
    assert pack(points, faces)["changes"].dtype == np.uint8
    assert error(points, faces) < LARGEST_ERROR


def test_neighbours_that_move_alike_cost_almost_nothing() -> None:
    """All of the motion is in the point that predicts the others; the last one belongs to no face."""
    path = np.cumsum(np.random.default_rng(0).normal(size=(300, 1, 3)), axis=0)
    points = (0.01 * path + waving(1, 0.0)).astype(np.float32)
    changes = pack(points, FACES)["changes"].astype(int)
    assert changes[0, 1:29, :, 2:].max() <= 8
    assert changes[:, 0].max() > 200


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e6, 60.0])
def test_what_does_not_fit_is_kept_as_it_is(value: float) -> None:
    points = waving(9, 0.1)
    points[4, 7, 1] = value
    assert np.array_equal(unpack(**pack(points, FACES)), points, equal_nan=True)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (
            {"changes": np.zeros((3, 30, 3, 4), np.uint8)},
            r"changes has the shape \(3, 30, 3, 4\), expected \(2,",
        ),
        ({"changes": np.zeros((2, 30, 3, 4))}, "changes has the shape"),
        ({"changes": np.zeros((2, 7, 3, 4), np.uint8)}, r"parents has the shape \(30,\), expected \(7,\)"),
        ({"origin": np.zeros(2, np.int64)}, "origin has the shape"),
        ({"origin": np.full(3, 2**62)}, "origin holds 4.61169e"),
        ({"parents": np.full(30, 31)}, "parents holds 31, expected 0 to 30"),
        ({"parents": np.arange(30)}, "its vertices do not fit together"),
    ],
)
def test_arrays_that_do_not_fit_together_are_refused(
    tmp_path: Path, wrong: dict[str, np.ndarray], said: str
) -> None:
    arrays = {"format": np.array("test-1"), **pack(waving(4, 0.0), FACES), **wrong}
    save_arrays(tmp_path / "a.npz", arrays)
    with pytest.raises(InputError, match=rf"a\.npz: {said}"):
        load_moving(tmp_path / "a.npz", "test-1", "moving points", {})
    assert load_arrays(tmp_path / "a.npz", "test-1", "moving points").keys() == arrays.keys()
