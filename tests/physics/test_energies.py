"""Measures of cloth against shapes whose answer is known, and against finite differences."""

import math
from collections.abc import Callable

import pytest
import torch
import trimesh
from torch import Tensor

from uvcloth.physics.energies import (
    GRAVITY,
    RestShape,
    acceleration_jitter,
    bend_energy,
    collision_energy,
    edge_change,
    edge_energy,
    fold_angle,
    fold_cosine,
    gravity_energy,
    hinge_angles,
    pin_energy,
    rest_shape,
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
    angles = hinge_angles(vertices, faces).expand(2, -1)
    torch.testing.assert_close(hinge_angles(moved, faces), angles, atol=1e-7, rtol=0)


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
    assert hinge_angles(shape, HALVES).item() == pytest.approx(angle, abs=1e-9)
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


ENERGIES: dict[str, Callable[[Tensor, RestShape], Tensor]] = {
    "edge": lambda vertices, cloth: edge_energy(vertices, cloth, 15.0),
    "bend": lambda vertices, cloth: bend_energy(vertices, cloth, 0.5),
    "gravity": gravity_energy,
    "collision": lambda vertices, cloth: collision_energy(vertices[..., 2], 0.1, 25.0),
    "pin": lambda vertices, cloth: pin_energy(vertices, 10.0),
}


def crumpled(seed: int) -> tuple[Tensor, RestShape]:
    """A sheet of a dozen vertices at rest, and three shapes of it that are none of its own: (3, 12, 3)."""
    grid = torch.cartesian_prod(torch.arange(4.0), torch.arange(3.0), torch.zeros(1)).double()
    corners = torch.arange(12).view(4, 3)
    a, b, c, d = (
        x.flatten() for x in (corners[:-1, :-1], corners[1:, :-1], corners[:-1, 1:], corners[1:, 1:])
    )
    faces = torch.cat([torch.stack([a, b, d], 1), torch.stack([a, d, c], 1)])
    noise = torch.randn(3, 12, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    return grid + 0.2 * noise, rest_shape(grid, faces, 0.3)


@pytest.mark.parametrize("name", ENERGIES)
@pytest.mark.parametrize("seed", [0, 1])
def test_energies_agree_with_finite_differences(name: str, seed: int) -> None:
    vertices, cloth = crumpled(seed)
    assert torch.autograd.gradcheck(lambda v: ENERGIES[name](v, cloth), vertices.requires_grad_())


@pytest.mark.parametrize("name", ENERGIES)
def test_many_poses_have_the_energies_of_each(name: str) -> None:
    vertices, cloth = crumpled(2)
    one_by_one = torch.stack([ENERGIES[name](each, cloth) for each in vertices])
    torch.testing.assert_close(ENERGIES[name](vertices, cloth), one_by_one)
    nested = ENERGIES[name](vertices.view(3, 1, 12, 3), cloth)
    torch.testing.assert_close(nested, one_by_one[:, None])


@pytest.mark.parametrize("name", ["edge", "bend", "gravity"])
def test_a_small_step_along_the_force_loses_what_the_force_does(name: str) -> None:
    vertices, cloth = crumpled(3)
    vertices.requires_grad_()
    energy = ENERGIES[name](vertices[0], cloth)
    force = -torch.autograd.grad(energy, vertices)[0][0]
    step = 1e-6 / force.norm() * force
    work = energy - ENERGIES[name](vertices[0] + step, cloth)
    assert work.item() == pytest.approx(1e-6 * float(force.norm()), rel=1e-3)


def test_a_stretched_spring_pulls_back_with_twice_its_stiffness() -> None:
    """A corner of the square drawn along one of its edges by 1 cm, which hardly changes the other."""
    cloth = rest_shape(SQUARE, HALVES, 0.3)
    assert edge_energy(SQUARE, cloth, 15.0) == 0.0
    pulled = SQUARE.clone()
    pulled[3, 1] += 0.01
    other = math.hypot(1.0, 0.01) - 1.0
    assert edge_energy(pulled, cloth, 15.0).item() == pytest.approx(15.0 * (0.01**2 + other**2))
    pulled.requires_grad_()
    edge_energy(pulled, cloth, 15.0).backward()
    assert -pulled.grad[0, 1].item() == pytest.approx(2 * 15.0 * 0.01)


def test_a_rigid_motion_needs_no_energy_of_edges_and_bends() -> None:
    vertices, cloth = crumpled(4)
    turn = torch.linalg.matrix_exp(torch.tensor([[0.0, -0.4, 0.1], [0.4, 0, 0.2], [-0.1, -0.2, 0]]).double())
    flat = torch.cartesian_prod(torch.arange(4.0), torch.arange(3.0), torch.zeros(1)).double()
    assert edge_energy(flat @ turn.T + 3.0, cloth, 15.0).item() == pytest.approx(0.0, abs=1e-24)
    assert bend_energy(flat @ turn.T + 3.0, cloth, 1.0).item() == pytest.approx(0.0, abs=1e-24)
    for name in ("edge", "bend"):
        moved = ENERGIES[name](vertices @ turn.T + 3.0, cloth)
        torch.testing.assert_close(moved, ENERGIES[name](vertices, cloth))


@pytest.mark.parametrize("angle", [-2.0, 0.3, math.pi / 2])
def test_a_fold_costs_the_distance_of_its_normals(angle: float) -> None:
    """|n1 - n2|^2 = 2 (1 - cos), which is 2 for a right angle; the measure of reports is half of that."""
    cloth = rest_shape(SQUARE, HALVES, 0.3)
    assert bend_energy(folded(angle), cloth, 5e-5).item() == pytest.approx(5e-5 * 2 * (1 - math.cos(angle)))
    cosine = fold_cosine(folded(angle), HALVES).item()
    assert cosine == pytest.approx(1 - math.cos(angle))
    assert cosine == pytest.approx(1 - math.cos(hinge_angles(folded(angle), HALVES).item()))


def test_masses_are_the_weight_of_the_sheet_and_lifting_it_takes_m_g_h() -> None:
    vertices, faces = sphere()
    cloth = rest_shape(vertices, faces, 0.3)
    area = trimesh.Trimesh(vertices, faces, process=False).area
    assert cloth.masses.sum().item() == pytest.approx(0.3 * area)
    square = rest_shape(SQUARE, HALVES, 0.3)
    assert square.masses.tolist() == pytest.approx([0.1, 0.05, 0.1, 0.05])
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    lifted = gravity_energy(torch.stack([SQUARE, SQUARE + up, SQUARE - 2 * up]), square)
    assert lifted.tolist() == pytest.approx([0.0, 0.3 * GRAVITY, -0.6 * GRAVITY])


def test_only_what_lacks_thickness_is_pushed() -> None:
    """A point 1 mm inside lacks 5 mm of a 4 mm thickness, one 3 mm outside 1 mm, one 5 mm outside nothing."""
    distance = torch.tensor([-0.001, 0.003, 0.005, 1e6], dtype=torch.float64, requires_grad=True)
    energy = collision_energy(distance, 0.004, 25.0)
    assert energy.item() == pytest.approx(25.0 * (0.005**2 + 0.001**2))
    energy.backward()
    assert distance.grad.tolist() == pytest.approx([-2 * 25.0 * 0.005, -2 * 25.0 * 0.001, 0.0, 0.0])


def test_a_pinned_vertex_pays_for_its_deformation() -> None:
    deformation = torch.tensor([[[0.01, 0.0, 0.0], [0.0, 0.0, 0.02]], [[0.0, 0.0, 0.0]] * 2])
    assert pin_energy(deformation, 10.0).tolist() == pytest.approx([10.0 * (1e-4 + 4e-4), 0.0])
