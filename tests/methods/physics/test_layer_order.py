"""A T-shirt that came out of its skirt is shown over it, and one that is tucked in beneath it."""

import numpy as np
import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_outfit
from uvcloth.methods.physics.outfit import CagedOutfit, PhysicsConfig, make_caged_outfit
from uvcloth.physics.shell import Shell
from uvcloth.player.outfit import Cloth

WORN = ("tops", "skirt")
LEAST_DISTANCE = 0.001


@pytest.fixture(scope="module")
def outfit(body: Body) -> Outfit:
    return Outfit(body, tuple(load_outfit(WORN, body)))


@pytest.fixture(scope="module")
def caged(outfit: Outfit) -> CagedOutfit:
    return make_caged_outfit(outfit, PhysicsConfig(quality="fast"))


def worn(outfit: Outfit, caged: CagedOutfit, outwards: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Points (n, 3) m of the T-shirt that were tucked in, and the skirt (N, 3) m, at rest on the body.

    outwards: metres by which the tucked-in part of the T-shirt is moved away from the body's axis first.
    """
    shirt, skirt = (garment.mesh.vertices for garment in outfit.garments)
    waist = float(skirt[:, 2].max()) - 0.03
    cages = torch.cat([each.cage.vertices for each in caged.garments]).double().numpy()
    tucked = np.zeros(len(cages), bool)
    tucked[caged.garments[0].rows] = cages[caged.garments[0].rows, 2] < waist
    cages[tucked, :2] *= 1.0 + outwards / np.linalg.norm(cages[tucked, :2], axis=1, keepdims=True)
    joints = torch.eye(3, 4, dtype=torch.float64).repeat(len(outfit.body.skeleton.names), 1, 1).numpy()
    cloth = Cloth(caged.baked)
    cloth.pull(cages, 100.0)
    cloth.start(joints)
    cloth.pull(None, 0.0)
    cloth.step(joints, 1.0 / 30.0)
    now, over = (torch.from_numpy(cloth.vertices(each)).float() for each in range(2))
    return now[shirt[:, 2] < waist - 0.03], over


def beyond(outfit: Outfit, points: torch.Tensor, skirt: torch.Tensor) -> torch.Tensor:
    """Mask (n,) of points from which a horizontal ray to the axis meets the outer side of the skirt."""
    to_axis = -points * torch.tensor([1.0, 1.0, 0.0])
    shell = Shell(skirt, outfit.garments[1].mesh.faces)
    distance, facing = shell.first_hit(points, torch.nn.functional.normalize(to_axis, dim=1), 0.15)
    return (facing < 0) & (distance > LEAST_DISTANCE)


def test_a_shirt_that_came_out_lies_over_the_skirt(outfit: Outfit, caged: CagedOutfit) -> None:
    hem, skirt = worn(outfit, caged, outwards=0.04)
    assert len(hem) > 100
    assert beyond(outfit, hem, skirt).float().mean() > 0.97


def test_a_tucked_shirt_stays_beneath(outfit: Outfit, caged: CagedOutfit) -> None:
    hem, skirt = worn(outfit, caged, outwards=0.0)
    assert not beyond(outfit, hem, skirt).any()
