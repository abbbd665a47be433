"""A limb has left its cloth as long as it is out of its cuff, also where none of its bones touches cloth."""

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.simulation.limbs import limbs_left_percent

SIDES = 12


def tube(start: Tensor, end: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """An open tube around an axis: vertices (2 SIDES, 3) m and faces."""
    along = torch.nn.functional.normalize(end - start, dim=0)
    across = torch.nn.functional.normalize(torch.linalg.cross(along, torch.tensor([0.3, 0.9, 0.1])), dim=0)
    turns = 2 * torch.pi * torch.arange(SIDES)[:, None] / SIDES
    ring = radius * (turns.cos() * across + turns.sin() * torch.linalg.cross(along, across))
    first = torch.arange(SIDES)
    after = (first + 1) % SIDES
    faces = torch.cat(
        [torch.stack([first, after, first + SIDES], 1), torch.stack([after, after + SIDES, first + SIDES], 1)]
    )
    return torch.cat([start + ring, end + ring]), faces


def left(body: Body, rest: Tensor, faces: Tensor, *moves: Tensor) -> float:
    """Percent of frames in which the tube, displaced in each, is left by a limb of the standing body."""
    vertices = torch.stack([rest + move for move in moves])
    still = torch.eye(3, 4).expand(len(moves), len(body.skeleton.names), 3, 4)
    nothing = torch.zeros(len(rest), dtype=torch.int32)
    return limbs_left_percent(vertices, rest, faces, still, body.skeleton, nothing)


def heads(body: Body, *names: str) -> list[Tensor]:
    return [body.skeleton.heads[body.skeleton.names.index(name)] for name in names]


def test_a_sleeve_may_slide_along_its_arm_and_not_come_off_it(body: Body) -> None:
    shoulder, elbow = heads(body, "LeftArm", "LeftForeArm")
    along = elbow - shoulder
    sleeve = tube(shoulder + 0.3 * along, shoulder + 0.7 * along, 0.08)
    assert left(body, *sleeve, 0.0 * along, 0.2 * along, 0.05 * torch.ones(3) / 3) == 0.0
    off = [torch.tensor([0.0, 0.0, 0.5]), 5.0 * along, torch.tensor([0.0, 0.3, 0.0])]
    assert left(body, *sleeve, 0.0 * along, *off) == 75.0


def test_cuffs_over_ankles_and_wrists_count(body: Body) -> None:
    for before, last in (("LeftLeg", "LeftFoot"), ("RightForeArm", "RightHand")):
        start, end = heads(body, before, last)
        cuff = tube(start + 0.5 * (end - start), end + 0.03 * (end - start), 0.1)
        assert left(body, *cuff, torch.zeros(3), torch.tensor([0.0, 0.4, 0.0])) == 50.0


def test_a_sleeve_may_be_swung_over_the_hand_and_a_trouser_leg_not_off_the_foot(body: Body) -> None:
    for before, last, percent in (("RightForeArm", "RightHand", 0.0), ("LeftLeg", "LeftFoot", 50.0)):
        start, end = heads(body, before, last)
        cuff = tube(start + 0.5 * (end - start), end, 0.1)
        along = torch.nn.functional.normalize(end - start, dim=0)
        assert left(body, *cuff, torch.zeros(3), 0.15 * along) == percent


def test_a_hem_that_both_legs_pass_is_no_cuff(body: Body) -> None:
    knees = torch.stack(heads(body, "LeftLeg", "RightLeg")).mean(0)
    skirt = tube(knees + torch.tensor([0.0, 0.0, 0.2]), knees, 0.3)
    assert left(body, *skirt, torch.zeros(3), torch.tensor([0.0, 1.0, 0.0])) == 0.0
