"""Long sleeves in simulation: which parts of the body they meet, and when a forearm has left its sleeve."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from tests.dataset.altered import altered
from tests.simulation.skinned import skinned_sequence
from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import COLLIDER_PARTS, FOREARM_PARTS, make_collider
from uvcloth.bodies.opened import make_opening
from uvcloth.bodies.posing import posed_skin
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.garments.garment import Garment
from uvcloth.garments.joined import join
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.rotations import from_axis_angles
from uvcloth.geometry.skeleton import joint_transforms, world_rotations
from uvcloth.geometry.skinning import skin
from uvcloth.motion.lead_in import LeadIn
from uvcloth.motion.library import load_clip
from uvcloth.physics.obstacle import Obstacle
from uvcloth.simulation.engine import Frame, Scene
from uvcloth.simulation.quality_check import examine
from uvcloth.simulation.run import simulate

UPPER = len(
    [side for regions, sides in COLLIDER_PARTS for side in sides if regions[0] not in ("calf", "forearm")]
)
"""Parts of the body that a T-shirt touches: all but calves and forearms."""


@pytest.fixture(scope="module")
def shirt(body: Body) -> Garment:
    return fit_template("shirt", body)


@pytest.fixture(scope="module")
def skinned(shirt: Garment, body: Body) -> SimulatedClip:
    """A long-sleeved shirt that is simply skinned."""
    return skinned_sequence(shirt, body)


@pytest.fixture(scope="module")
def sleeves(body: Body, skinned: SimulatedClip) -> Tensor:
    """The vertices around the left forearm, a third of its length off the elbow: (N,) bool."""
    elbow, wrist = (
        body.skeleton.heads[body.skeleton.names.index(f"Left{end}")] for end in ("ForeArm", "Hand")
    )
    along = (skinned.garments[0].rest - elbow) @ (wrist - elbow) / (wrist - elbow).square().sum()
    touches = make_collider(body).touches(skinned.garments[0].rest, body.mesh.vertices)
    return touches[FOREARM_PARTS[0]] & (along > 0.33)


def test_a_worn_sleeve_is_accepted(skinned: SimulatedClip, shirt: Garment, body: Body) -> None:
    seen, reason = examine(skinned, [shirt], body)
    assert reason is None
    assert seen.garments[0].metadata["left_percent"] == 0.0
    assert seen.garments[0].metadata["inside_percent"] < 0.2


def test_a_sleeve_inside_its_forearm_is_inside_the_body(
    skinned: SimulatedClip, sleeves: Tensor, shirt: Garment, body: Body
) -> None:
    bones = [body.skeleton.heads[body.skeleton.names.index(name)] for name in ("LeftForeArm", "LeftHand")]
    along = (bones[1] - bones[0]) / (bones[1] - bones[0]).norm()
    rest = shirt.mesh.vertices
    axis = bones[0] + ((rest - bones[0]) @ along)[:, None] * along
    sunken = torch.where(sleeves[:, None], axis + 0.2 * (rest - axis), rest)
    vertices = skin(sunken, shirt.smooth_weights, skinned.transforms)
    seen, reason = examine(altered(skinned, vertices=vertices), [shirt], body)
    share = 100.0 * float(sleeves.float().mean())
    assert reason is not None
    assert 0.7 * share < seen.garments[0].metadata["inside_percent"] < 1.1 * share


def test_a_forearm_beside_its_sleeve_has_left_it(
    skinned: SimulatedClip, sleeves: Tensor, shirt: Garment, body: Body
) -> None:
    aside = torch.where(sleeves[:, None], torch.tensor([0.0, 0.05, 0.0]), torch.zeros(3))
    _, reason = examine(altered(skinned, vertices=skinned.vertices + aside), [shirt], body)
    assert reason == "a limb has left its cloth in 100 % of the frames"


@pytest.mark.parametrize(("name", "parts"), [("tops", UPPER), ("shirt", UPPER + len(FOREARM_PARTS))])
def test_only_parts_that_the_garment_touches_are_in_its_scene(name: str, parts: int, body: Body) -> None:
    class Looking:
        def describe(self) -> dict[str, Any]:
            return {}

        def simulate(self, scene: Scene, after: Frame | None = None) -> Iterator[Frame]:
            assert len(scene.collider_parts) == len(scene.touches) == parts
            assert scene.touches.any(1).all()
            yield from (Frame(index, vertices) for index, vertices in enumerate(scene.skinned))

    clip = load_clip("walk", body).window(0, 3)
    simulate(
        clip, 0, (join(fit_template(name, body), body),), body, Looking(), LeadIn(rest=1, blend=2, ramp=1)
    )


def _arm_at_hip(body: Body) -> Tensor:
    """Transforms (J, 3, 4) of a body whose forearms are in its hips and thighs."""
    local = torch.eye(3).expand(1, len(body.skeleton.names), 3, 3).clone()
    for name, degrees in (("LeftArm", 62.0), ("RightArm", -62.0)):
        turn = torch.tensor([[0.0, math.radians(degrees), 0.0]])
        local[0, body.skeleton.names.index(name)] = from_axis_angles(turn)[0]
    turned = world_rotations(body.skeleton.parents, local)
    return joint_transforms(body.skeleton, turned, torch.zeros(1, 3))[0]


def test_a_forearm_in_the_hip_is_opened_where_it_has_a_sleeve(body: Body) -> None:
    """Its sleeve would be caught between both, and the arm leave it (validation window 26_01)."""
    posed = posed_skin(body, _arm_at_hip(body)[None])[0]
    moved = {}
    for name in ("tops", "shirt"):
        mesh = fit_template(name, body).mesh
        collider = make_collider(body)
        touched = collider.touches(mesh.vertices, body.mesh.vertices).any(1)
        fitted = collider.for_cloth(touched)
        closed = fitted.vertices(posed)
        forearms = torch.cat([collider.parts[part].unique() for part in FOREARM_PARTS])
        opened = make_opening(fitted, body.mesh.vertices).opened(closed)
        moved[name] = float((opened - closed)[forearms].norm(dim=1).max())
        assert (fitted.pressed == collider.pressed) == (name == "tops")
    assert moved["shirt"] > moved["tops"] + 0.01


def test_contact_opens_forearms_for_sleeves_as_the_simulation_does(body: Body) -> None:
    obstacle = Obstacle(make_collider(body), body.mesh.vertices)
    posed, mesh = posed_skin(body, _arm_at_hip(body)[None])[0], fit_template("shirt", body).mesh
    collider = make_collider(body)
    touched = collider.touches(mesh.vertices, body.mesh.vertices).any(1)
    opened = make_opening(collider.for_cloth(touched), body.mesh.vertices).opened(collider.vertices(posed))
    garment = obstacle.contact_garment(mesh.vertices)
    obstacle.update(posed)
    for part in FOREARM_PARTS:
        points = opened[collider.parts[part].unique()]
        touches = torch.full((len(points),), 1 << part, dtype=torch.int32)
        assert obstacle.skin(points, replace(garment, touches=touches)).distance.abs().max() < 1e-5
