"""Opened colliders: room between the parts where a pose presses them together, and nothing else changes."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from uvcloth.bodies.body import REGIONS, Body
from uvcloth.bodies.collider import ARM_PARTS, TORSO_PART, Collider, make_collider
from uvcloth.bodies.opened import GAP, SLOPE, ColliderOpening, make_opening
from uvcloth.bodies.posing import posed_skin
from uvcloth.geometry.mesh import edge_lengths, unique_edges
from uvcloth.geometry.rotations import from_axis_angles
from uvcloth.geometry.skeleton import joint_transforms, world_rotations
from uvcloth.physics.surface import BodySurface

TOLERANCE = 0.002
"""Metres by which the gap may be less: distances are those to planes through vertices some 2 cm apart."""

REACHED = 0.055
"""Metres along the skin from the other part from which on a push may be as long as these poses need."""


@pytest.fixture(scope="module")
def collider(body: Body) -> Collider:
    return make_collider(body)


@pytest.fixture(scope="module")
def opening(body: Body, collider: Collider) -> ColliderOpening:
    return make_opening(collider, body.mesh.vertices)


def bent(body: Body, angles: dict[str, tuple[float, float, float]]) -> Tensor:
    """Collider vertices (C, 3) m of the body with joints turned by degrees about x, y and z."""
    local = torch.eye(3).expand(1, len(body.skeleton.names), 3, 3).clone()
    for name, degrees in angles.items():
        turn = torch.tensor(degrees) * (math.pi / 180)
        local[0, body.skeleton.names.index(name)] = from_axis_angles(turn[None])[0]
    turned = world_rotations(body.skeleton.parents, local)
    transforms = joint_transforms(body.skeleton, turned, torch.zeros(1, 3))
    return make_collider(body).vertices(posed_skin(body, transforms))[0]


def arm_down(body: Body, degrees: float) -> Tensor:
    return bent(body, {"LeftArm": (0.0, degrees, 0.0)})


def skin_of(collider: Collider, part: int, body: Body) -> Tensor:
    faces = collider.parts[part]
    return faces[(faces < len(body.mesh.vertices)).all(1)].unique()


def test_at_rest_nothing_moves(body: Body, collider: Collider, opening: ColliderOpening) -> None:
    rest = collider.vertices(body.mesh.vertices)
    assert torch.equal(opening.opened(rest), rest)


@pytest.mark.parametrize("degrees", [30.0, 40.0, 50.0])
def test_an_arm_pressed_into_the_ribs_ends_with_a_gap(
    degrees: float, body: Body, collider: Collider, opening: ColliderOpening
) -> None:
    rest, posed = collider.vertices(body.mesh.vertices), arm_down(body, degrees)
    opened = opening.opened(posed)
    arm = ARM_PARTS[0]
    for side, (part, other) in enumerate(((arm, TORSO_PART), (TORSO_PART, arm))):
        own = skin_of(collider, part, body)
        own = own[torch.from_numpy(opening.runtime.sections["opening.allowed"][side])[own] > SLOPE * REACHED]
        before, after, wanted = (
            BodySurface(vertices, collider.parts[other]).closest(vertices[own]).signed_distance
            for vertices in (posed, opened, rest)
        )
        assert float((wanted.clamp(max=GAP) - after).max()) < TOLERANCE
        if degrees == 50.0:
            assert float(before.min()) < -0.03


def test_what_is_far_from_the_other_parts_stays_to_the_bit(body: Body, opening: ColliderOpening) -> None:
    posed = arm_down(body, 40.0)
    moved = (opening.opened(posed) != posed).any(1)[: len(body.mesh.vertices)]
    assert 50 < int(moved.sum()) < 500
    x = body.mesh.vertices[:, 0]
    assert not moved[x < 0].any()
    corners = moved[body.mesh.faces].any(1)
    assert not (corners & torch.isin(body.regions, torch.tensor([REGIONS.index("hand")]))).any()


@pytest.mark.parametrize("degrees", [30.0, 45.0, 60.0])
def test_neighbours_move_alike(degrees: float, body: Body, opening: ColliderOpening) -> None:
    posed = arm_down(body, degrees)
    moves = opening.opened(posed) - posed
    edges = unique_edges(body.mesh.faces)
    change = (moves[edges[:, 0]] - moves[edges[:, 1]]).norm(dim=1)
    assert float((change / edge_lengths(body.mesh.vertices, edges)).max()) < 1.0


def test_a_small_step_of_the_arm_is_a_small_step_of_what_is_opened(
    body: Body, opening: ColliderOpening
) -> None:
    poses = torch.stack([arm_down(body, 20.0 + 0.1 * step) for step in range(300)])
    moves = opening.opened(poses) - poses
    steps, changes = ((frames[1:] - frames[:-1]).norm(dim=2).amax(1) for frames in (poses, moves))
    assert float((changes / steps).max()) < 0.6
    assert float(moves.norm(dim=2).max()) > 0.02


def test_frames_are_opened_by_themselves(body: Body, opening: ColliderOpening) -> None:
    poses = torch.stack([arm_down(body, degrees) for degrees in (50.0, 0.0, 35.0, 50.0)])
    together = opening.opened(poses)
    assert torch.equal(together, torch.stack([opening.opened(pose) for pose in poses]))
    assert torch.equal(together[0], together[3])


SQUAT = {f"{side}{joint}": (x, 0.0, 0.0) for side in ("Left", "Right") for joint, x in
         (("UpLeg", -120.0), ("Leg", 145.0))}  # fmt: skip


def test_a_squat_has_room_between_calf_and_thigh_and_belly(
    body: Body, collider: Collider, opening: ColliderOpening
) -> None:
    posed = bent(body, SQUAT)
    opened = opening.opened(posed)
    for part, other in collider.pressed[2:]:
        own = skin_of(collider, part, body)
        before, after = (
            BodySurface(vertices, collider.parts[other]).closest(vertices[own]).signed_distance
            for vertices in (posed, opened)
        )
        inside = int((before < 0).sum())
        assert int((after < 0).sum()) <= 0.5 * inside


def test_a_mirrored_body_is_opened_mirrored(body: Body, opening: ColliderOpening) -> None:
    mirror = torch.tensor([-1.0, 1.0, 1.0])
    mesh = replace(body.mesh, vertices=body.mesh.vertices * mirror, faces=body.mesh.faces.flip(1))
    other = replace(body, mesh=mesh, sides=-body.sides)
    count = len(body.mesh.vertices)
    collider = make_collider(other)
    mirrored = make_opening(collider, mesh.vertices)
    for posed in (arm_down(body, 45.0), bent(body, SQUAT)):
        expected = opening.opened(posed)[:count] * mirror
        opened = mirrored.opened(collider.vertices(posed[:count] * mirror))[:count]
        # Of two vertices close to the middle that mirror each other, one is a point that measures.
        torch.testing.assert_close(opened, expected, atol=1e-4, rtol=0)


def test_a_body_without_arms_or_legs_is_opened_where_it_has_parts(body: Body) -> None:
    limbs = torch.tensor([REGIONS.index(name) for name in ("upper_arm", "thigh", "calf", "foot")])
    bust = replace(body, regions=torch.where(torch.isin(body.regions, limbs), len(REGIONS), body.regions))
    collider = make_collider(bust)
    posed = collider.vertices(arm_down(body, 50.0)[: len(body.mesh.vertices)])
    assert torch.equal(make_opening(collider, body.mesh.vertices).opened(posed), posed)


def test_a_collider_of_other_parts_stays_as_it_is(body: Body) -> None:
    vertices = arm_down(body, 50.0)[: len(body.mesh.vertices)]
    whole = Collider((body.mesh.faces,), ())
    assert torch.equal(make_opening(whole, body.mesh.vertices).opened(vertices), vertices)
