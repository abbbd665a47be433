"""A motion that stops: its speed falls smoothly to zero, and then nothing moves."""

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.motion.capture import find_jump
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import load_clip
from uvcloth.motion.stop import BRAKING_SECONDS, come_to_rest


@pytest.fixture(scope="module")
def run(body: Body) -> Clip:
    return load_clip("run", body).window(0, 40)


def test_a_run_comes_to_rest_in_its_last_pose(run: Clip) -> None:
    stopped = come_to_rest(run, 1.5)
    braking = round(BRAKING_SECONDS * run.fps)
    begin = len(run) - 1 - braking // 2
    assert len(stopped) == len(run) + 45
    for moved, own in ((stopped.rotations, run.rotations), (stopped.translation, run.translation)):
        torch.testing.assert_close(moved[: begin + 1], own[: begin + 1], atol=1e-6, rtol=0)
        standing = moved[begin + braking :]
        assert torch.equal(standing, standing[:1].expand_as(standing))
        torch.testing.assert_close(standing[0], own[-1], atol=1e-6, rtol=0)
    assert find_jump(stopped) is None


def test_a_steady_motion_brakes_without_a_jump_of_its_speed(run: Clip) -> None:
    """The root goes 3 m/s: the speed falls in every frame of the braking, by at most a quarter of it."""
    path = torch.arange(len(run))[:, None] / run.fps * torch.tensor([0.0, -3.0, 0.0])
    steady = Clip("steady", run.skeleton, run.rotations[:1].expand_as(run.rotations), path, run.fps)
    speed = come_to_rest(steady, 0.5).translation.diff(dim=0).norm(dim=1) * run.fps
    falls = -speed.diff()
    assert speed[0] == pytest.approx(3.0, abs=1e-4)
    assert speed[-1] == 0.0
    assert falls.min() > -1e-4
    assert falls.max() < 0.26 * 3.0
    assert int((falls > 1e-3).sum()) <= round(BRAKING_SECONDS * run.fps) + 1


def test_a_pose_or_a_short_hold_is_no_special_case(run: Clip) -> None:
    assert len(come_to_rest(run.window(0, 1), 0.5)) == 16
    assert len(come_to_rest(run, 0.05)) == len(run) + 2
    assert torch.allclose(come_to_rest(run, 0.0).rotations, run.rotations, atol=1e-6)
