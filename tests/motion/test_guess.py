"""Roles from where joints are: our own skeleton's names and places say the same, however it stands."""

from dataclasses import replace

import pytest
import torch

from tests.characters.made_up import t_posed
from uvcloth.bodies.body import Body
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.motion.guess import find_roles, guess_roles

Y_UP = torch.tensor([[100.0, 0, 0], [0, 0, -100], [0, 100, 0]])
ASKEW = torch.tensor([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
TURNED = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def by_name(skeleton: Skeleton) -> dict[str, int]:
    """Roles by names; our body's fingers are two joints, of which the guess takes the first."""
    fingers = {
        f"{side.lower()}_fingers": skeleton.names.index(f"{side}FingerBase") for side in ("Left", "Right")
    }
    return skeleton.roles | fingers


def with_joints_between(skeleton: Skeleton, bones: tuple[str, ...], crown: float) -> Skeleton:
    """The skeleton with a twist joint in the middle of some bones and one at the top of the head."""
    names, parents, heads = [], [], []
    for joint, (name, parent) in enumerate(zip(skeleton.names, skeleton.parents, strict=True)):
        above = names.index(skeleton.names[parent]) if parent >= 0 else -1
        if name.removeprefix("Left").removeprefix("Right") in bones:
            names.append(f"{name} twist")
            parents.append(above)
            heads.append((skeleton.heads[joint] + skeleton.heads[parent]) / 2)
            above = len(names) - 1
        names.append(name)
        parents.append(above)
        heads.append(skeleton.heads[joint])
    top = heads[names.index("Head")] + torch.tensor([0.0, 0.0, crown])
    return Skeleton((*names, "top"), (*parents, names.index("Head")), torch.stack([*heads, top]))


@pytest.mark.parametrize("axes", [torch.eye(3), Y_UP, TURNED, TURNED @ TURNED, ASKEW, Y_UP @ ASKEW.T])
def test_our_skeleton_is_recognized_without_its_names(body: Body, axes: torch.Tensor) -> None:
    for pose in (body, t_posed(body)):
        skeleton = pose.skeleton
        assert guess_roles(skeleton.parents, skeleton.heads @ axes.T) == by_name(skeleton)


def test_twist_joints_and_the_top_of_the_head_play_no_role(body: Body) -> None:
    skeleton = with_joints_between(body.skeleton, ("Leg", "Foot", "ForeArm", "Hand"), crown=0.2)
    expected, found = by_name(skeleton), guess_roles(skeleton.parents, skeleton.heads)
    assert {role: skeleton.names[joint] for role, joint in found.items()} == {
        role: skeleton.names[joint] for role, joint in expected.items()
    }


def test_a_map_goes_before_the_guess_and_names_before_both_need_it(body: Body) -> None:
    skeleton = body.skeleton
    nameless = tuple(f"bone {joint}" for joint in range(len(skeleton.names)))
    roles, guessed = find_roles(nameless, skeleton.parents, skeleton.heads, {"head": "bone 13"}, {})
    assert guessed
    assert roles["head"] == 13
    assert roles["left_shin"] == skeleton.names.index("LeftLeg")
    assert find_roles(skeleton.names, skeleton.parents, skeleton.heads, {}, {}) == (
        skeleton.roles,
        False,
    )


def test_what_does_not_stand_like_a_person_is_not_guessed(body: Body) -> None:
    skeleton = body.skeleton
    chain = tuple(range(-1, 11))
    assert guess_roles(chain, torch.rand(12, 3, generator=torch.Generator().manual_seed(0))) == {}
    one_leg = skeleton.heads.clone()
    one_leg[skeleton.names.index("RightLeg") :] += torch.tensor([0.0, -0.4, 0.3])
    assert guess_roles(skeleton.parents, one_leg) == {}
    lying = replace(skeleton, heads=skeleton.heads * torch.tensor([1.0, 1.0, 0.0]))
    assert guess_roles(lying.parents, lying.heads) == {}
