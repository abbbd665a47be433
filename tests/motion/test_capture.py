"""Faults of captures, put into a sound one, and those of the recordings that are known for them."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from scipy.spatial.transform import Rotation

from tests.thorough import always
from uvcloth.bodies.body import Body
from uvcloth.geometry.skeleton import local_rotations, world_rotations
from uvcloth.motion.bvh import read_bvh
from uvcloth.motion.capture import find_jump, find_standstill
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import builtin_clips, load_clip


@pytest.fixture(scope="module")
def walk(body: Body) -> Clip:
    return load_clip("walk", body)


def turned(clip: Clip, name: str, frame: int, degrees: float) -> Clip:
    """A joint turned, with all that hangs on it, from a frame on."""
    joint = clip.skeleton.names.index(name)
    local = local_rotations(clip.skeleton.parents, clip.rotations)
    turn = torch.from_numpy(Rotation.from_euler("x", degrees, degrees=True).as_matrix()).float()
    local[frame:, joint] = local[frame:, joint] @ turn
    return replace(clip, rotations=world_rotations(clip.skeleton.parents, local))


def still(clip: Clip, names: tuple[str, ...], start: int, end: int) -> Clip:
    """Joints that keep their bend from a frame to another."""
    joints = [clip.skeleton.names.index(name) for name in names]
    local = local_rotations(clip.skeleton.parents, clip.rotations)
    local[start : end + 1, joints] = local[start, joints]
    return replace(clip, rotations=world_rotations(clip.skeleton.parents, local))


def test_sound_captures_have_no_fault(body: Body) -> None:
    for name in builtin_clips():
        clip = load_clip(name, body)
        assert find_jump(clip) is None
        assert find_standstill(clip) is None


def test_a_jump_names_the_joint_nearest_the_root_and_the_frame(walk: Clip) -> None:
    said = str(find_jump(turned(walk, "LeftArm", 50, 120.0), 7))
    assert said.startswith("LeftArm turns by 1")
    assert said.endswith("degrees in frame 57")
    assert find_jump(turned(walk, "LeftArm", 50, 75.0)) is None


@pytest.mark.parametrize("name", ["LeftHand", "RightHandFinger1", "LThumb", "RightToeBase"])
def test_joints_that_no_cloth_hangs_on_do_not_count(walk: Clip, name: str) -> None:
    assert find_jump(turned(walk, name, 50, 170.0)) is None
    assert find_standstill(still(walk, (name,), 20, 90)) is None


def test_a_joint_that_stands_still_for_a_second_is_named(walk: Clip) -> None:
    assert find_standstill(still(walk, ("RightLeg",), 20, 60), 100) == (
        "RightLeg stands still from frame 120 to 160 while others move"
    )
    assert find_standstill(still(walk, ("RightLeg",), 20, 45)) is None


def test_a_person_who_stands_and_a_joint_that_the_capture_lacks_do_not_count(walk: Clip) -> None:
    assert find_standstill(still(walk, walk.skeleton.names, 20, 90)) is None
    assert find_standstill(still(walk, ("Neck",), 0, len(walk))) is None
    assert find_standstill(walk.window(3, 1)) is None
    assert find_jump(walk.window(3, 1)) is None


@pytest.mark.parametrize(
    ("clip", "joint", "frame"),
    always(
        [("03_02", "RightArm", 13), ("90_11", "RightFoot", 2)],
        [
            ("03_02", "RightArm", 13),
            ("88_01", "LeftFoot", 19),
            ("90_02", "LeftFoot", 100),
            ("90_08", "RightFoot", 57),
            ("90_11", "RightFoot", 2),
            ("135_x06", "LeftArm", 449),
        ],
    ),
)
def test_it_is_the_capture_that_jumps_and_not_the_retargeting(
    mocap_folder: Path, body: Body, clip: str, joint: str, frame: int
) -> None:
    """The angle between two frames of one joint is the same in the file's channels and on the body."""
    path = mocap_folder / "cmu" / f"{clip}.bvh"
    raw, moved = read_bvh(path), load_clip(path, body)
    name = {"LeftArm": "lShldr"}.get(joint, joint) if clip.startswith("135") else joint
    angles = []
    for motion, index in (
        (raw, raw.skeleton.names.index(name)),
        (moved, body.skeleton.names.index(joint)),
    ):
        turn = motion.rotations[frame - 1, index].T @ motion.rotations[frame, index]
        angles.append(float(torch.rad2deg(torch.arccos((turn.trace() - 1.0) / 2.0))))
    assert angles[0] == pytest.approx(angles[1], abs=0.5)
    assert angles[0] > 90.0
    assert find_jump(moved) is not None
