from dataclasses import replace

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.motion.arm_clearance import TOLERANCE, clear_arms
from uvcloth.motion.arms import TORSO_CLEARANCE, arm_joints, missing_clearance
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import load_clip
from uvcloth.motion.options import MotionOptions


def captured(body: Body) -> Clip:
    """A clip that takes both forearms through the torso."""
    return load_clip("spin", body, MotionOptions(clear_arms=False))


def acceleration(clip: Clip, joints: list[int]) -> torch.Tensor:
    """Second differences (T - 2, K) of the joints' rotations."""
    turns = clip.rotations[:, joints]
    return (turns[2:] - 2.0 * turns[1:-1] + turns[:-2]).flatten(-2).norm(dim=-1)


def test_arms_are_out_of_torso_and_legs_and_as_smooth_as_before(body: Body) -> None:
    clip = captured(body)
    assert float(missing_clearance(body, clip.transforms()).max()) > 0.08 + TORSO_CLEARANCE
    cleared = load_clip("spin", body)
    assert float(missing_clearance(body, cleared.transforms()).max()) < TOLERANCE + 0.001
    shoulders = [upper for upper, *_ in arm_joints(body)]
    before, after = acceleration(clip, shoulders), acceleration(cleared, shoulders)
    assert float(after.max()) < 1.05 * float(before.max())


def test_only_arms_move_as_a_whole_and_only_near_torso_and_legs(body: Body) -> None:
    clip = captured(body)
    cleared = clear_arms(clip, body)
    arms = sorted({joint for upper, *_ in arm_joints(body) for joint in clip.skeleton.branch(upper)})
    others = sorted({*range(len(clip.skeleton.names))} - {*arms})
    assert torch.equal(cleared.rotations[:, others], clip.rotations[:, others])
    assert torch.equal(cleared.translation, clip.translation)
    for upper, forearm, hand, _ in arm_joints(body):
        for joint in (forearm, hand):
            bent = [each.rotations[:, upper].mT @ each.rotations[:, joint] for each in (clip, cleared)]
            assert (bent[0] - bent[1]).abs().max() < 1e-5
    far = missing_clearance(body, clip.transforms()).amax(1) < -0.23
    assert far.any()
    assert (cleared.rotations - clip.rotations)[far].abs().max() < 0.02


def test_arms_outside_stay_as_they_are(body: Body) -> None:
    clip = load_clip("walk", body, MotionOptions(clear_arms=False))
    assert clear_arms(clip, body) is clip


def test_turns_take_no_arm_inside_in_other_frames(body: Body) -> None:
    """Where a clip begins or ends with an arm inside, the turn swings back before or after it."""
    cleared = clear_arms(captured(body).window(96, 24), body)
    assert float(missing_clearance(body, cleared.transforms()).max()) < 2.0 * TOLERANCE + 0.001


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_clips_of_few_frames(body: Body, frames: int) -> None:
    clip = captured(body).window(110, frames)
    assert float(missing_clearance(body, clip.transforms()).max()) > 0.05 + TORSO_CLEARANCE
    assert float(missing_clearance(body, clear_arms(clip, body).transforms()).max()) < 0.003


def test_the_place_of_the_person_does_not_matter(body: Body) -> None:
    clip = captured(body)
    here = clear_arms(clip, body)
    away = replace(clip, translation=clip.translation.double() + torch.tensor([1000.0, 500.0, 0.0]))
    assert (clear_arms(away, body).rotations - here.rotations).abs().max() < 1e-3


def test_a_rate_of_120_gives_the_same_path(body: Body) -> None:
    slow = load_clip("spin", body)
    fast = load_clip("spin", body, MotionOptions(fps=120.0))
    assert (fast.rotations[::4] - slow.rotations).abs().max() < 0.15
