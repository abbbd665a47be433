"""Forces inside cloth against gradients of energies, and against laws that hold for any cloth."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from tests.physics.cloth.energies import hinge_energy, membrane_energy
from tests.physics.cloth.stepping import elastic_forces
from tests.simulation.physics.scenes import sheet
from uvcloth.physics.cloth.cloth import Damping, make_cloth
from uvcloth.physics.fabric import AIR_DENSITY, Fabric

STIFF = Fabric(stretch=40.0, poisson=0.3, bend=1e-4, drag=0.0)
UNDAMPED = Damping(stretch=0.0, bend=0.0)
STRETCH_ALONE = replace(STIFF, bend=0.0)


def uneven_sheet(bumps: float = 0.004) -> tuple[Tensor, Tensor]:
    """A sheet of 0.2 m whose vertices lie off their places and off the plane."""
    rest, faces = sheet(0.2, 0.2, 9, 9)
    return rest + bumps * torch.randn(rest.shape, generator=torch.manual_seed(0)), faces


def deformed(rest: Tensor, seed: int, bumps: float = 0.003) -> Tensor:
    """Points moved by a random linear map, and each by some millimetres."""
    draw = torch.manual_seed(seed)
    turn = torch.eye(3) + 0.1 * torch.randn(3, 3, generator=draw)
    return rest @ turn.T + bumps * torch.randn(rest.shape, generator=draw)


def assert_like(found: NDArray[np.float32], expected: Tensor, share: float = 2e-5) -> None:
    """Equal to within a share of the largest."""
    expected = expected.numpy()
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=share * np.abs(expected).max())


@pytest.mark.parametrize("compression", [1.0, 0.5])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_membrane_pulls_down_the_slope_of_its_energy(seed: int, compression: float) -> None:
    rest, faces = uneven_sheet()
    cloth = make_cloth(rest.numpy(), faces.numpy(), STRETCH_ALONE, compression=compression, damping=UNDAMPED)
    points = deformed(rest, seed).double().requires_grad_()
    membrane_energy(points, rest.double(), faces, STRETCH_ALONE, compression).backward()
    assert_like(elastic_forces(cloth, points.detach()), -points.grad)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_hinges_turn_down_the_slope_of_their_energy(seed: int) -> None:
    rest, faces = uneven_sheet()
    cloth = make_cloth(rest.numpy(), faces.numpy(), STIFF, damping=UNDAMPED)
    limp = make_cloth(rest.numpy(), faces.numpy(), STRETCH_ALONE, damping=UNDAMPED)
    nothing = np.zeros_like(cloth.membrane.area)
    bending = replace(cloth, membrane=cloth.membrane._replace(shear=nothing, spread=nothing))
    points = deformed(rest, seed, bumps=0.0015).double().requires_grad_()
    hinge_energy(points, rest.double(), faces, STIFF).backward()
    assert_like(elastic_forces(bending, points.detach()), -points.grad, 1e-4)
    both, membrane = elastic_forces(cloth, points.detach()), elastic_forces(limp, points.detach())
    np.testing.assert_allclose(both - membrane, elastic_forces(bending, points.detach()), atol=1e-6)


def test_cloth_at_rest_has_no_forces_wherever_it_is() -> None:
    rest, faces = uneven_sheet()
    cloth = make_cloth(rest.numpy(), faces.numpy(), STIFF)
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.manual_seed(4)))[0]
    turn = turn * torch.linalg.det(turn)
    held = np.abs(elastic_forces(cloth, deformed(rest, 1))).max()
    assert np.abs(elastic_forces(cloth, rest @ turn.T + 0.3)).max() < 1e-4 * held


def test_damping_takes_energy_of_any_motion_but_a_rigid_one() -> None:
    rest, faces = uneven_sheet()
    cloth = make_cloth(rest.numpy(), faces.numpy(), STIFF, damping=Damping(stretch=1e-3, bend=1e-2))
    points, draw = deformed(rest, 1), torch.manual_seed(5)
    elastic = elastic_forces(cloth, points)

    def viscous(speeds: Tensor) -> NDArray[np.float64]:
        return (elastic_forces(cloth, points, speeds) - elastic).astype(np.float64)

    first, second = (torch.randn(rest.shape, generator=draw) for _ in range(2))
    size = np.abs(viscous(first)).max()
    assert (viscous(first) * first.numpy()).sum() < 0.0
    work = (viscous(first) * second.numpy()).sum(), (viscous(second) * first.numpy()).sum()
    assert work[0] == pytest.approx(work[1], rel=1e-3)
    spin, drift = torch.randn(2, 3, generator=draw).unbind(0)
    rigid = drift + torch.linalg.cross(spin.expand_as(points), points)
    assert np.abs(viscous(rigid)).max() < 1e-5 * size


def test_forces_inside_cloth_neither_push_nor_turn_it_as_a_whole() -> None:
    """Some of its faces are squeezed to less than half their height."""
    rest, faces = uneven_sheet()
    cloth = make_cloth(rest.numpy(), faces.numpy(), STIFF, damping=Damping(stretch=1e-3, bend=1e-2))
    points = deformed(rest, 2, bumps=0.006)
    found = elastic_forces(cloth, points, torch.randn(points.shape, generator=torch.manual_seed(6))).astype(
        np.float64
    )
    size = np.abs(found).sum()
    assert np.abs(found.sum(0)).max() < 1e-6 * size
    assert np.abs(np.cross(points.numpy(), found).sum(0)).max() < 1e-6 * size * 0.2


def test_air_pushes_a_face_by_half_its_density_and_the_square_of_the_speed_along_the_normal() -> None:
    """A face of 2 cm2 at rest is stretched to 4 cm2 and moves at 3 m/s along its normal and 5 m/s across."""
    rest = torch.tensor([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.0, 0.02, 0.0]])
    cloth = make_cloth(rest.numpy(), np.array([[0, 1, 2]]), Fabric(drag=1.3), damping=UNDAMPED)
    points = rest * torch.tensor([2.0, 1.0, 1.0])
    speeds = torch.tensor([5.0, 0.0, -3.0]).expand(3, 3)
    moved = elastic_forces(cloth, points, speeds) - elastic_forces(cloth, points)
    push = 0.5 * AIR_DENSITY * 1.3 * 4e-4 * 3.0**2
    np.testing.assert_allclose(moved, np.tile([0.0, 0.0, push / 3.0], (3, 1)), rtol=1e-4, atol=1e-8)
    blown = elastic_forces(cloth, points, wind=(5.0, 0.0, -3.0)) - elastic_forces(cloth, points)
    np.testing.assert_allclose(blown, moved, atol=1e-7)
