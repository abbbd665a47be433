"""Energies of two-triangle sheets above a box, worked out by hand."""

import pytest
import torch
from torch import Tensor

from tests.small_body import small_body
from train.cloth_energy import ClothEnergy, ClothMaterial
from uvcloth.physics.energies import GRAVITY

CPU = torch.device("cpu")
MATERIAL = ClothMaterial(edge=15.0, bend=0.5, mass=0.3, collision=50.0, thickness=0.005)
TOP, SIDE = 0.05, 0.06
"""Metres: height of the box's upper face, side of the sheet."""
FACES = torch.tensor([[0, 1, 2], [0, 2, 3]])
BODY = small_body(scale=0.5)


def sheet(height: float, side: float = SIDE) -> Tensor:
    """A square of two triangles around the axis: (4, 3), its normal upwards."""
    corners = torch.tensor([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    return torch.cat([side * corners, torch.full((4, 1), TOP + height)], dim=1)


def standing(*lifted: float) -> Tensor:
    """Transforms (B, 2, 3, 4) of a box at rest that is lifted, m."""
    transforms = torch.eye(3, 4).repeat(len(lifted), 2, 1, 1)
    transforms[:, :, 2, 3] = torch.tensor(lifted)[:, None]
    return transforms


def test_a_stretched_sheet_pays_for_its_edges_alone() -> None:
    rest = sheet(0.02)
    stretched = rest * torch.tensor([1.1, 1.0, 1.0])
    energies = ClothEnergy(BODY, rest, [FACES], MATERIAL, 2, CPU)(
        torch.stack([rest, stretched]), standing(0, 0)
    )
    longer = 2 * (0.1 * SIDE) ** 2 + ((2.21**0.5 - 2**0.5) * SIDE) ** 2
    assert energies["edge"].tolist() == pytest.approx([0.0, 15.0 * longer], rel=1e-4, abs=1e-12)
    assert energies["bend"].tolist() == pytest.approx([0.0, 0.0], abs=1e-9)
    assert energies["collision"].tolist() == [0.0, 0.0]
    weight = 0.3 * SIDE**2 * GRAVITY * (TOP + 0.02)
    assert energies["gravity"].tolist() == pytest.approx([weight, weight], rel=1e-5)


def test_a_sheet_folded_upright_pays_for_the_fold_and_for_the_height() -> None:
    rest = sheet(0.02)
    folded = rest.clone()
    folded[3] = rest[0] / 2 + rest[2] / 2 + torch.tensor([0.0, 0.0, SIDE / 2**0.5])
    energy = ClothEnergy(BODY, rest, [FACES], MATERIAL, 2, CPU)
    energies = energy(torch.stack([rest, folded]), standing(0, 0))
    assert energies["edge"].tolist() == pytest.approx([0.0, 0.0], abs=1e-12)
    # The normals of the halves are a right angle apart: |n1 - n2|^2 = 2.
    assert energies["bend"].tolist() == pytest.approx([0.0, 0.5 * 2.0], abs=1e-6)
    corner = 0.3 * SIDE**2 / 6
    lifted = float(energies["gravity"][1] - energies["gravity"][0])
    assert lifted == pytest.approx(corner * GRAVITY * SIDE / 2**0.5, rel=1e-4)


def test_each_pose_collides_with_its_own_body() -> None:
    """Two millimetres above the box lack three of five; two below, after it rose by four, lack seven."""
    rest = sheet(0.002)
    energy = ClothEnergy(BODY, rest, [FACES], MATERIAL, 3, CPU)
    found = energy(rest.expand(3, 4, 3), standing(0.0, 0.004, -0.01))["collision"]
    expected = [50.0 * 4 * 0.003**2, 50.0 * 4 * 0.007**2, 0.0]
    assert found.tolist() == pytest.approx(expected, rel=1e-3, abs=1e-9)


def test_what_lies_too_deep_is_pushed_straight_up() -> None:
    rest = sheet(0.002)
    posed = rest[None].clone().requires_grad_()
    energy = ClothEnergy(BODY, rest, [FACES], MATERIAL, 1, CPU)(posed, standing(0.0))["collision"]
    (slope,) = torch.autograd.grad(energy.sum(), posed)
    expected = torch.tensor([0.0, 0.0, -2 * 50.0 * 0.003]).expand(1, 4, 3)
    torch.testing.assert_close(slope, expected, rtol=1e-3, atol=1e-6)


def test_an_outer_sheet_collides_with_the_inner_one() -> None:
    """Both are clear of the box; the outer is two millimetres over the inner, or one under it."""
    inner, outer = sheet(0.02), sheet(0.022, 0.5 * SIDE)
    rest = torch.cat([inner, outer])
    energy = ClothEnergy(BODY, rest, [FACES, FACES + 4], MATERIAL, 2, CPU)
    crossed = rest - torch.tensor([0.0, 0.0, 0.003]) * (torch.arange(8) >= 4)[:, None]
    energies = energy(torch.stack([rest, crossed]), standing(0.0, 0.0))
    expected = [50.0 * 4 * 0.003**2, 50.0 * 4 * 0.006**2]
    assert energies["collision"].tolist() == pytest.approx(expected, rel=1e-3)
