"""Energies of two-triangle sheets above a box by hand, and the options that they come from."""

from dataclasses import asdict, replace

import pytest
import torch
from torch import Tensor

from tests.small_body import small_body
from train.pbns.energy import PROGRAM_FABRIC, EnergyConfig, FabricOptions, PBNSEnergy
from uvcloth.errors import InputError
from uvcloth.geometry.records import CPU
from uvcloth.geometry.units import GRAVITY
from uvcloth.physics.fabric import FABRICS, Fabric

FABRIC = Fabric(density=0.3, stretch=30.0 / (3**0.5 / 2), bend=0.5 * 3**0.5)
CONFIG = EnergyConfig(collision=100.0, thickness=0.005, pin=20.0)
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


def energies_of(
    rest: Tensor, posed: Tensor, transforms: Tensor, faces: tuple[Tensor, ...] = (FACES,)
) -> dict[str, Tensor]:
    """Energies (B,) of outfits (B, N, 3), the first vertex of which is pinned."""
    energy = PBNSEnergy(BODY, rest, faces, torch.tensor([0]), FABRIC, CONFIG, len(posed), CPU)
    return energy(posed - rest, posed, transforms)


def test_a_stretched_sheet_pays_for_its_edges_alone() -> None:
    rest = sheet(0.02)
    stretched = rest * torch.tensor([1.1, 1.0, 1.0])
    energies = energies_of(rest, torch.stack([rest, stretched]), standing(0, 0))
    longer = 2 * (0.1 * SIDE) ** 2 + ((2.21**0.5 - 2**0.5) * SIDE) ** 2
    assert energies["stretch"].tolist() == pytest.approx([0.0, 15.0 * longer], rel=1e-4, abs=1e-12)
    assert energies["bend"].tolist() == pytest.approx([0.0, 0.0], abs=1e-9)
    assert energies["collision"].tolist() == [0.0, 0.0]
    assert energies["pin"].tolist() == pytest.approx([0.0, 10.0 * (0.05 * SIDE) ** 2])
    weight = 0.3 * SIDE**2 * GRAVITY * (TOP + 0.02)
    assert energies["gravity"].tolist() == pytest.approx([weight, weight], rel=1e-5)


def test_a_sheet_folded_upright_pays_for_the_fold_and_for_the_height() -> None:
    rest = sheet(0.02)
    folded = rest.clone()
    folded[3] = rest[0] / 2 + rest[2] / 2 + torch.tensor([0.0, 0.0, SIDE / 2**0.5])
    energies = energies_of(rest, torch.stack([rest, folded]), standing(0, 0))
    assert energies["stretch"].tolist() == pytest.approx([0.0, 0.0], abs=1e-12)
    # The normals of the halves are a right angle apart: |n1 - n2|^2 = 2.
    assert energies["bend"].tolist() == pytest.approx([0.0, 0.5 * 2.0], abs=1e-6)
    corner = 0.3 * SIDE**2 / 6
    lifted = float(energies["gravity"][1] - energies["gravity"][0])
    assert lifted == pytest.approx(corner * GRAVITY * SIDE / 2**0.5, rel=1e-4)


def test_each_pose_collides_with_its_own_body() -> None:
    """Two millimetres above the box lack three of five; two below, after it rose by four, lack seven."""
    rest = sheet(0.002)
    found = energies_of(rest, rest.expand(3, 4, 3), standing(0.0, 0.004, -0.01))["collision"]
    expected = [50.0 * 4 * 0.003**2, 50.0 * 4 * 0.007**2, 0.0]
    assert found.tolist() == pytest.approx(expected, rel=1e-3, abs=1e-9)


def test_what_lies_too_deep_is_pushed_straight_up() -> None:
    rest = sheet(0.002)
    posed = rest[None].clone().requires_grad_()
    energy = energies_of(rest, posed, standing(0.0))["collision"]
    (slope,) = torch.autograd.grad(energy.sum(), posed)
    expected = torch.tensor([0.0, 0.0, -100.0 * 0.003]).expand(1, 4, 3)
    torch.testing.assert_close(slope, expected, rtol=1e-3, atol=1e-6)


def test_an_outer_sheet_collides_with_the_inner_one() -> None:
    """Both are clear of the box; the outer is two millimetres over the inner, or one under it."""
    inner, outer = sheet(0.02), sheet(0.022, 0.5 * SIDE)
    rest = torch.cat([inner, outer])
    crossed = rest - torch.tensor([0.0, 0.0, 0.003]) * (torch.arange(8) >= 4)[:, None]
    energies = energies_of(rest, torch.stack([rest, crossed]), standing(0.0, 0.0), (FACES, FACES + 4))
    expected = [50.0 * 4 * 0.003**2, 50.0 * 4 * 0.006**2]
    assert energies["collision"].tolist() == pytest.approx(expected, rel=1e-3)


def test_the_fabric_of_the_program_has_its_weights() -> None:
    """15 N/m of squared changes of length, 5e-5 J of squared differences of normals."""
    energy = PBNSEnergy(BODY, sheet(0.02), (FACES,), torch.tensor([0]), PROGRAM_FABRIC, CONFIG, 1, CPU)
    torch.testing.assert_close(energy.cloth.spring, torch.full((5,), 30.0))
    torch.testing.assert_close(energy.cloth.fold, torch.full((1,), 1e-4))


def test_options_name_a_fabric_and_change_numbers_of_it() -> None:
    assert FabricOptions().resolved() == PROGRAM_FABRIC
    assert FabricOptions("silk").resolved() == FABRICS["silk"]
    changed = FabricOptions("denim", stretch=120.0, density=0.4).resolved()
    assert changed == replace(FABRICS["denim"], stretch=120.0, density=0.4)
    assert asdict(FabricOptions(bend=1e-3).resolved())["bend"] == 1e-3


@pytest.mark.parametrize("name", ["stretch", "bend", "density"])
@pytest.mark.parametrize("value", [-1.0, 1e5, float("nan"), float("inf")])
def test_numbers_that_no_fabric_has_are_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"--{name} .*: the fabric's {name} is .*, expected"):
        FabricOptions(**{name: value}).resolved()


@pytest.mark.parametrize("name", ["collision", "thickness", "pin"])
@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_springs_of_less_than_no_stiffness_are_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"--{name} {value}: has to be 0 or more"):
        EnergyConfig(**{name: value})
