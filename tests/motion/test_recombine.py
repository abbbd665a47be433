from pathlib import Path

import pytest
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.skeleton import local_rotations
from uvcloth.motion.clip_splits import find_sources
from uvcloth.motion.draw_poses import draw_poses, local_angles
from uvcloth.motion.library import load_clip
from uvcloth.motion.poses import PoseDatabase, load_poses, save_poses
from uvcloth.motion.recombine import joint_parts, legs_and_trunk, recombine


def always(vertices: Tensor) -> bool:
    return True


@pytest.fixture(scope="module")
def drawn(body: Body) -> PoseDatabase:
    return draw_poses(find_sources(["walk", "jump", "dance"]), body, always, apart=0.8)


def test_parts_of_the_skeleton(body: Body) -> None:
    parts = dict(zip(body.skeleton.names, joint_parts(body.skeleton).tolist(), strict=True))
    assert {parts[name] for name in ("Hips", "LeftUpLeg", "RightToeBase", "LHipJoint")} == {0}
    assert {parts[name] for name in ("LowerBack", "Spine1", "Neck", "Head")} == {1}
    assert {parts[name] for name in ("LeftShoulder", "LeftForeArm", "LThumb")} == {2}
    assert {parts[name] for name in ("RightArm", "RightHand", "RightFingerBase")} == {3}


def test_each_part_moves_as_its_donor_does(body: Body, drawn: PoseDatabase, tmp_path: Path) -> None:
    more = recombine(drawn, body, always, 12)
    made = more.select(torch.arange(len(drawn), len(more)))
    assert len(made) == 12
    assert torch.equal(more.select(torch.arange(len(drawn))).rotations, drawn.rotations)
    assert made.splits.eq(0).all()
    angles = local_angles(made.rotations, body.skeleton).view(12, -1, 3)
    before = local_angles(drawn.rotations, body.skeleton).view(len(drawn), -1, 3)
    part = joint_parts(body.skeleton)[1:]
    for index, donors in enumerate(made.donors):
        expected = before[donors[part], torch.arange(len(part))]
        torch.testing.assert_close(angles[index], expected, atol=1e-4, rtol=0)
    torch.testing.assert_close(made.rotations[:, 0], drawn.rotations[made.donors[:, 0], 0])
    assert torch.equal(made.frames, drawn.frames[made.donors[:, 0]])
    own = made.donors[:, 1:2] == made.donors[:, 2:]
    assert own.any()
    assert not own.all()
    save_poses(more, tmp_path / "poses.npz")
    assert torch.equal(load_poses(tmp_path / "poses.npz", body).donors, more.donors)


def test_only_training_poses_give_parts(body: Body, drawn: PoseDatabase) -> None:
    made = recombine(drawn, body, always, 40).donors[len(drawn) :]
    assert drawn.splits[made.flatten()].eq(0).all()


def test_poses_that_are_not_valid_are_made_again(body: Body, drawn: PoseDatabase) -> None:
    asked: list[Tensor] = []

    def every_other(vertices: Tensor) -> bool:
        asked.append(vertices)
        return len(asked) % 2 == 0

    assert len(recombine(drawn, body, every_other, 5)) == len(drawn) + 5
    assert len(asked) == 10


def test_the_same_seed_makes_the_same_poses(body: Body, drawn: PoseDatabase) -> None:
    first, second, other = (recombine(drawn, body, always, 6, seed).donors for seed in (1, 1, 2))
    assert torch.equal(first, second)
    assert not torch.equal(first, other)


def test_what_cannot_be_made_is_said(body: Body, drawn: PoseDatabase) -> None:
    assert recombine(drawn, body, always, 0) is drawn
    with pytest.raises(InputError, match="only 0 combinations are valid on body"):
        recombine(drawn, body, lambda vertices: False, 2)


def test_a_clip_takes_the_trunk_and_arms_of_another_on_its_hips(body: Body) -> None:
    run, twirl = load_clip("run", body).window(0, 20), load_clip("twirl", body).window(0, 12)
    made = legs_and_trunk(run, twirl)
    parents, above = body.skeleton.parents, joint_parts(body.skeleton) > 0
    local = [local_rotations(parents, clip.rotations[:12]) for clip in (made, run, twirl)]
    assert len(made) == 12
    assert torch.equal(made.translation, run.translation[:12])
    torch.testing.assert_close(local[0][:, ~above], local[1][:, ~above], atol=1e-5, rtol=0)
    torch.testing.assert_close(local[0][:, above], local[2][:, above], atol=1e-5, rtol=0)
    assert float((local[1] - local[2])[:, above].abs().max()) > 0.3
