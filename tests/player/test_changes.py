"""Wind, gravity and fabrics that change while cloth is played."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Outfit as WornOutfit
from uvcloth.methods.physics.outfit import PhysicsConfig, make_caged_outfit
from uvcloth.motion.library import load_clip
from uvcloth.player.outfit import Cloth, Outfit

FAST = PhysicsConfig("fast")
FPS = 30.0
FRAMES = 12

Joints = NDArray[np.float64]


@pytest.fixture(scope="module")
def pose(body: Body) -> Joints:
    """The first pose of a walk (J, 3, 4)."""
    return np.asarray(load_clip("walk", body).transforms(torch.float64).numpy()[0])


def standing(cloth: Cloth, pose: Joints, frames: int = FRAMES) -> NDArray[np.float64]:
    """Vertices (N, 3) m after so many frames in a pose."""
    cloth.start(pose)
    for _ in range(frames):
        cloth.step(pose, 1.0 / FPS)
    return cloth.vertices(0)


def test_wind_carries_cloth_along_in_the_world(outfit: Outfit, pose: Joints) -> None:
    still, blown, turned = Cloth(outfit), Cloth(outfit), Cloth(outfit)
    quarter = Rotation.from_euler("z", 90.0, degrees=True).as_matrix()
    blown.set_world(wind=(8.0, 0.0, 0.0))
    turned.set_world(wind=quarter @ (8.0, 0.0, 0.0))
    rest, after = standing(still, pose), standing(blown, pose)
    assert (after - rest)[:, 0].mean() > 0.02
    np.testing.assert_allclose(standing(turned, quarter @ pose), after @ quarter.T, rtol=0.0, atol=1e-4)


def test_cloth_without_weight_does_not_hang(outfit: Outfit, pose: Joints) -> None:
    hanging, floating = Cloth(outfit), Cloth(outfit)
    floating.set_world(gravity=(0.0, 0.0, 0.0))
    heights = [standing(cloth, pose)[:, 2] for cloth in (hanging, floating)]
    assert (heights[1] - heights[0]).mean() > 0.002


def test_a_changed_fabric_is_that_of_an_outfit_baked_of_it(
    worn: WornOutfit, outfit: Outfit, pose: Joints
) -> None:
    garment = worn.garments[0]
    fabric = replace(
        garment.fabric,
        density=2.0 * garment.fabric.density,
        stretch=3.0 * garment.fabric.stretch,
        bend=40.0 * garment.fabric.bend,
    )
    baked = make_caged_outfit(replace(worn, garments=(replace(garment, fabric=fabric),)), FAST).baked
    changed, before = Cloth(outfit), standing(Cloth(outfit), pose)
    changed.set_fabric(0, density=2.0, stretch=3.0, bend=40.0)
    expected, found = standing(Cloth(Outfit(baked.content)), pose), standing(changed, pose)
    assert np.abs(expected - before).max() > 0.01
    assert (
        np.linalg.norm(found - expected, axis=1).mean()
        < 0.1 * np.linalg.norm(before - expected, axis=1).mean()
    )
    changed.set_fabric(0)
    np.testing.assert_array_equal(standing(changed, pose), before)


def test_saved_cloth_keeps_wind_gravity_and_fabric(outfit: Outfit, pose: Joints) -> None:
    cloth, later = Cloth(outfit), Cloth(outfit)
    cloth.set_world(wind=(0.0, 5.0, 0.0), gravity=(0.0, 0.0, -3.7))
    cloth.set_fabric(0, bend=20.0)
    standing(cloth, pose, 3)
    later.restore(cloth.save())
    for each in (cloth, later):
        each.step(pose, 1.0 / FPS)
    np.testing.assert_array_equal(later.vertices(0), cloth.vertices(0))


@pytest.mark.parametrize("wind", [(1e3, 0.0, 0.0), (np.nan, 0.0, 0.0), (0.0, np.inf, 0.0)])
def test_a_storm_that_no_cloth_follows_is_refused(outfit: Outfit, wind: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="wind of more than 100 m/s, or gravity"):
        Cloth(outfit).set_world(wind=wind)


@pytest.mark.parametrize("factor", [0.0, -1.0, 1e3, np.nan])
@pytest.mark.parametrize("name", ["density", "stretch", "bend"])
def test_factors_that_no_fabric_has_are_refused(outfit: Outfit, name: str, factor: float) -> None:
    cloth = Cloth(outfit)
    with pytest.raises(ValueError, match=r"a factor on the fabric of garment 0 is not between 0\.01"):
        cloth.set_fabric(0, **{name: factor})
