from dataclasses import replace

import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation

from uvcloth.bodies.body import REGIONS, Body
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skinning import skin
from uvcloth.motion.clip import Clip
from uvcloth.physics.self_contact import BODY_PARTS, PART_NAMES, SelfContact, tolerances


@pytest.fixture(scope="module")
def boxes(body: Body) -> Body:
    """A torso, a cube of 20 cm around the origin, and a left forearm, one of 10 cm, 20 cm in front of it."""
    parts = [(0.2, (0.0, 0.0, 0.0), "torso", 0), (0.1, (0.0, -0.35, 0.0), "forearm", 1)]
    meshes = [trimesh.creation.box((size,) * 3).subdivide().subdivide() for size, *_ in parts]
    for mesh, (_, place, _, _) in zip(meshes, parts, strict=True):
        mesh.apply_translation(place)
    both = trimesh.util.concatenate(meshes)
    regions = [[REGIONS.index(name)] * len(m.faces) for m, (_, _, name, _) in zip(meshes, parts, strict=True)]
    sides = [[side] * len(m.faces) for m, (*_, side) in zip(meshes, parts, strict=True)]
    vertices = torch.from_numpy(both.vertices).float()
    faces = torch.from_numpy(both.faces).long()
    return replace(
        body,
        mesh=Mesh(vertices, faces, vertices[:, :2], faces),
        regions=torch.tensor(regions).flatten(),
        sides=torch.tensor(sides).flatten(),
    )


def push(boxes: Body, distance: float) -> torch.Tensor:
    """The boxes with the forearm that far inside the torso."""
    moved = boxes.mesh.vertices.clone()
    forearm = boxes.mesh.faces[boxes.regions == REGIONS.index("forearm")].unique()
    moved[forearm, 1] += 0.2 + distance
    return moved


@pytest.mark.parametrize("distance", [0.004, 0.015, 0.03, 0.06])
def test_the_depth_is_how_far_one_box_is_pushed_into_another(boxes: Body, distance: float) -> None:
    torso, forearm = PART_NAMES.index("torso"), PART_NAMES.index("forearm")
    depths = SelfContact(boxes).depths(push(boxes, distance))
    assert float(depths[torso, forearm]) == pytest.approx(distance, abs=1e-5)
    depths[torso, forearm] = depths[forearm, torso] = 0.0
    assert float(depths.max()) == 0.0


def test_a_forearm_may_touch_the_waist_and_not_enter_it(boxes: Body) -> None:
    contact = SelfContact(boxes)
    assert contact.clear(boxes.mesh.vertices)
    assert contact.clear(push(boxes, 0.018))
    assert not contact.clear(push(boxes, 0.022))
    # As clear as at rest once it is gone again: nothing is left over from the pose before.
    assert contact.clear(push(boxes, -0.01))


def test_flesh_gives_way_by_centimetres_and_bone_by_one() -> None:
    allowed = tolerances()
    for first, second, metres in (
        ("torso", "upper_arm", 0.03),
        ("torso", "forearm", 0.02),
        ("upper_arm", "forearm", 0.03),
        ("torso", "thigh", 0.03),
        ("thigh", "thigh", 0.03),
        ("thigh", "calf", 0.03),
        ("torso", "calf", 0.01),
    ):
        row, column = PART_NAMES.index(first), PART_NAMES.index(second)
        assert float(allowed[row, column]) == float(allowed[column, row]) == pytest.approx(metres)


def test_every_region_of_the_body_belongs_to_one_part() -> None:
    assert sorted(region for regions, _ in BODY_PARTS for region in regions) == sorted(REGIONS)


def turned(body: Body, joint: str, degrees: float, axis: str = "y") -> torch.Tensor:
    """The body with a joint, and what hangs on it, turned about an axis of the world."""
    turn = torch.from_numpy(Rotation.from_euler(axis, degrees, degrees=True).as_matrix()).float()
    below = {body.skeleton.names.index(joint)}
    for child, parent in enumerate(body.skeleton.parents):
        if parent in below:
            below.add(child)
    rotations = torch.eye(3).repeat(1, len(body.skeleton.names), 1, 1)
    rotations[0, list(below)] = turn
    clip = Clip("turned", body.skeleton, rotations, body.skeleton.heads[:1], 30.0)
    return skin(body.mesh.vertices, body.weights, clip.transforms())[0]


def test_a_body_is_clear_at_rest_and_with_hanging_arms_or_bent_knees(body: Body) -> None:
    contact = SelfContact(body)
    assert float(contact.depths(body.mesh.vertices).max()) == 0.0
    for joint, degrees, axis in (
        ("LeftArm", 40.0, "y"),
        ("RightForeArm", -90.0, "z"),
        ("LeftLeg", 100.0, "x"),
    ):
        assert contact.clear(turned(body, joint, degrees, axis)), joint


def test_an_arm_or_a_leg_through_the_body_is_not_clear(body: Body) -> None:
    contact = SelfContact(body)
    depths = contact.depths(turned(body, "LeftArm", 100.0))
    torso, left_forearm = PART_NAMES.index("torso"), PART_NAMES.index("forearm")
    assert float(torch.maximum(depths, depths.T)[torso, left_forearm]) > 0.03
    for joint, degrees, axis in (
        ("LeftArm", 100.0, "y"),
        ("RightArm", -100.0, "y"),
        ("LeftUpLeg", 25.0, "y"),
    ):
        assert not contact.clear(turned(body, joint, degrees, axis)), joint
