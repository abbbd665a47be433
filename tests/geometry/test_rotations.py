"""Conversions of rotations against scipy's."""

from itertools import permutations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from uvcloth.geometry.rotations import (
    from_axis_angles,
    from_euler,
    from_quaternions,
    to_axis_angles,
    to_quaternions,
)

TURNS = Rotation.concatenate(
    [
        Rotation.random(500, rng=np.random.default_rng(0)),
        Rotation.identity(1),
        Rotation.from_rotvec([[1e-5, 0, 0], [0, 1e-2, 0], [3.1, 0.2, 0], [0, np.pi, 0], [0, 0, -np.pi]]),
    ]
)
MATRICES = torch.from_numpy(TURNS.as_matrix())


def test_quaternions_there_and_back() -> None:
    quaternions = to_quaternions(MATRICES.view(2, -1, 3, 3))
    assert quaternions.shape == (2, len(MATRICES) // 2, 4)
    same = (quaternions.flatten(0, 1) * torch.from_numpy(TURNS.as_quat())).sum(1).abs()
    torch.testing.assert_close(same, torch.ones_like(same), atol=1e-12, rtol=0)
    torch.testing.assert_close(from_quaternions(quaternions).flatten(0, 1), MATRICES, atol=1e-12, rtol=0)


def test_quaternions_of_single_precision_are_of_unit_length() -> None:
    quaternions = to_quaternions(MATRICES.float())
    assert quaternions.dtype == torch.float64
    assert (quaternions.norm(dim=-1) - 1).abs().max() < 1e-12
    assert (from_quaternions(quaternions) - MATRICES).abs().max() < 1e-6


def test_axis_angles_there_and_back() -> None:
    vectors = torch.from_numpy(TURNS.as_rotvec())
    torch.testing.assert_close(from_axis_angles(vectors), MATRICES, atol=1e-12, rtol=0)
    less = vectors.norm(dim=1) < 3.0
    torch.testing.assert_close(to_axis_angles(MATRICES)[less], vectors[less], atol=1e-9, rtol=0)
    back = from_axis_angles(to_axis_angles(MATRICES.view(2, -1, 3, 3)))
    torch.testing.assert_close(back.flatten(0, 1), MATRICES, atol=1e-7, rtol=0)


@pytest.mark.parametrize("axes", ["".join(order) for order in permutations("xyz")] + ["zxz", "zy", "x"])
def test_euler_angles_in_every_order(axes: str) -> None:
    angles = 6.0 * torch.rand(20, len(axes), dtype=torch.float64) - 3.0
    expected = Rotation.from_euler(axes.upper(), angles.numpy()).as_matrix()
    torch.testing.assert_close(from_euler(axes, angles), torch.from_numpy(expected), atol=1e-14, rtol=0)
