"""Measures of cloth against shapes whose answer is known, and against finite differences."""

import math

import pytest
import torch
import trimesh

from uvcloth.geometry.mesh import hinges
from uvcloth.physics.measures import (
    acceleration_jitter,
    edge_change,
    fold_angle,
    fold_cosine,
    hinge_angles,
)

SQUARE = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=torch.float64)
HALVES = torch.tensor([[0, 1, 2], [0, 2, 3]])


def folded(angle: float) -> torch.Tensor:
    """The square folded about its diagonal 0-2, the fourth corner going below for positive angles."""
    diagonal = torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64) / 2**0.5
    outward = torch.tensor([-1.0, 1.0, 0.0], dtype=torch.float64) / 2
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64) / 2**0.5
    corner = diagonal / 2**0.5 + math.cos(angle) * outward - math.sin(angle) * up
    return torch.cat([SQUARE[:3], corner[None]])


def sphere() -> tuple[torch.Tensor, torch.Tensor]:
    mesh = trimesh.creation.icosphere(2)
    return torch.tensor(mesh.vertices), torch.tensor(mesh.faces)


def test_a_rigid_motion_changes_nothing():
    vertices, faces = sphere()
    turn = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64, generator=torch.manual_seed(0)))[0]
    turn = turn * torch.linalg.det(turn)
    moved = torch.stack([vertices, vertices @ turn.T + 3.0])
    torch.testing.assert_close(edge_change(moved, vertices, faces), torch.zeros(2).double())
    angles = hinge_angles(vertices, hinges(faces)).expand(2, -1)
    torch.testing.assert_close(hinge_angles(moved, hinges(faces)), angles, atol=1e-7, rtol=0)


def test_stretch_and_compression_both_count():
    vertices, faces = sphere()
    moved = torch.stack([1.1 * vertices, 0.9 * vertices])
    edges = trimesh.Trimesh(vertices, faces, process=False).edges_unique_length
    torch.testing.assert_close(
        edge_change(moved, vertices, faces), torch.full((2,), 0.1 * edges.mean(), dtype=torch.float64)
    )


@pytest.mark.parametrize("angle", [-3.0, -1.0, -1e-3, 0.0, 1e-3, 0.5, 3.0])
def test_a_folded_square_has_the_angle_it_was_folded_by(angle: float):
    shape = folded(angle)
    assert hinge_angles(shape, hinges(HALVES)).item() == pytest.approx(angle, abs=1e-9)
    assert fold_angle(shape, HALVES).item() == pytest.approx(abs(angle), abs=1e-9)


def test_face_angles_agree_with_trimesh():
    vertices, faces = sphere()
    expected = trimesh.Trimesh(vertices, faces, process=False).face_adjacency_angles.mean()
    assert fold_angle(vertices, faces).item() == pytest.approx(expected)


def test_gradients_agree_with_finite_differences():
    generator = torch.manual_seed(1)
    vertices = folded(0.4)[None] + 0.05 * torch.randn(2, 4, 3, dtype=torch.float64, generator=generator)
    vertices.requires_grad_()
    for measure in (
        lambda v: edge_change(v, 1.2 * SQUARE, HALVES),
        lambda v: fold_angle(v, HALVES),
        lambda v: acceleration_jitter(torch.cat([v, v**2]), 2.0),
    ):
        assert torch.autograd.gradcheck(measure, vertices)


def test_a_flat_sheet_has_a_finite_gradient():
    vertices = SQUARE.clone().requires_grad_()
    fold_angle(vertices, HALVES).backward()
    assert torch.isfinite(vertices.grad).all()


def test_free_fall_has_the_acceleration_of_gravity_and_steady_motion_none():
    time = torch.arange(10, dtype=torch.float64)[:, None, None] / 30
    fall = torch.tensor([0.0, 0.0, -9.81 / 2]) * time**2 + torch.zeros(10, 5, 3)
    assert acceleration_jitter(fall, 30.0).tolist() == pytest.approx([9.81] * 8)
    steady = torch.ones(10, 5, 3) * time
    assert acceleration_jitter(steady, 30.0).abs().max() < 1e-9


def test_a_fold_has_the_cosine_of_its_angle() -> None:
    for angle in (-2.0, 0.3, math.pi / 2):
        found = fold_cosine(folded(angle), HALVES).item()
        assert found == pytest.approx(1 - math.cos(angle))
        assert found == pytest.approx(1 - math.cos(hinge_angles(folded(angle), hinges(HALVES)).item()))


def test_the_slope_of_a_hinge_is_known_where_it_is_flat() -> None:
    """The corner that goes down by d turns the face by d over its height of half a diagonal."""
    (slope,) = torch.autograd.functional.jacobian(lambda v: hinge_angles(v, hinges(HALVES)), SQUARE)
    assert slope[3].tolist() == pytest.approx([0.0, 0.0, -(2**0.5)])
    assert slope.sum(0).tolist() == pytest.approx([0.0, 0.0, 0.0])
