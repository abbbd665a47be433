import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from tests.motion.bvh_text import Joint, bvh_text, performer, still
from tests.thorough import always
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.roles import joint_roles
from uvcloth.geometry.rotations import smallest_rotation
from uvcloth.motion.bvh import read_bvh
from uvcloth.motion.clip import Clip
from uvcloth.motion.retarget import lowest_vertex, resample, retarget

MOCAP = Path(os.environ.get("UVCLOTH_MOCAP", Path(__file__).parents[3] / "shared" / "mocap"))
CAPTURES = sorted((MOCAP / "cmu").glob("*.bvh"))
every_capture = pytest.mark.parametrize(
    "path",
    always(CAPTURES[::5], CAPTURES)
    or [pytest.param(None, marks=pytest.mark.skip(reason=f"no captures in {MOCAP} (UVCLOTH_MOCAP)"))],
    ids=lambda path: path.stem if path else "absent",
)
EVERY = 8
"""Frames of a capture are thinned by this, for speed."""


def posed(clip: Clip, *names: str) -> Tensor:
    """World positions (T, names, 3) of joints."""
    joints = [clip.skeleton.names.index(name) for name in names]
    transforms = clip.transforms()[:, joints]
    heads = clip.skeleton.heads[joints]
    return (transforms[..., :3] @ heads[:, :, None]).squeeze(-1) + transforms[..., 3]


def direction(clip: Clip, start: str, end: str) -> Tensor:
    points = posed(clip, start, end)
    return torch.nn.functional.normalize(points[:, 1] - points[:, 0], dim=-1)


def clip_of(tmp_path: Path, joints: list[Joint], values: np.ndarray, fps: float = 30.0) -> Clip:
    path = tmp_path / "capture.bvh"
    path.write_text(bvh_text(joints, values, 1.0 / fps))
    return read_bvh(path)


def moving(joints: list[Joint], frames: int = 9) -> np.ndarray:
    """Smooth motion of every channel: 40 degrees and 5 units to and fro."""
    columns = sum(len(joint[3]) for joint in joints)
    phase = np.random.default_rng(3).uniform(0, 2 * np.pi, columns)
    values = 40.0 * np.sin(np.linspace(0, 2, frames)[:, None] + phase)
    values[:, :3] /= 8.0
    return values


@pytest.mark.parametrize("arms_down", [False, True])
def test_the_zero_pose_is_the_t_pose_with_straight_legs(tmp_path: Path, arms_down: bool, body: Body) -> None:
    joints = performer(arms_down)
    clip = clip_of(tmp_path, joints, still(joints))
    splay = np.deg2rad(20.0)
    result = retarget(clip, body)
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        arm = torch.tensor([0.0, 0.0, -1.0] if arms_down else [sign, 0.0, 0.0])
        leg = torch.tensor([sign * np.sin(splay), 0.0, -np.cos(splay)], dtype=torch.float32)
        for start, end, expected in (
            ("Arm", "ForeArm", arm),
            ("ForeArm", "Hand", arm),
            ("UpLeg", "Leg", leg),
            ("Leg", "Foot", leg),
        ):
            found = direction(result, side + start, side + end)
            torch.testing.assert_close(found, expected.expand_as(found), atol=1e-5, rtol=0)
    spine = result.rotations[:, [result.skeleton.names.index(n) for n in ("Hips", "Spine1", "Head")]]
    torch.testing.assert_close(spine, torch.eye(3).expand_as(spine))


def test_hands_without_fingers_go_on_as_their_forearms(tmp_path: Path, body: Body) -> None:
    """The rest poses differ: arms of the clip point sideways, those of the body down."""
    joints = performer()
    fingers = {joint for role, joint in body.skeleton.roles.items() if role.endswith("fingers")}
    names = tuple(f"part {n}" if n in fingers else name for n, name in enumerate(body.skeleton.names))
    stump = replace(body, skeleton=replace(body.skeleton, names=names))
    result = retarget(clip_of(tmp_path, joints, still(joints)), stump)
    for side in ("Left", "Right"):
        forearm, hand = (result.rotations[:, names.index(side + part)] for part in ("ForeArm", "Hand"))
        torch.testing.assert_close(hand, forearm, atol=1e-5, rtol=0)
        assert (forearm - torch.eye(3)).abs().max() > 0.2


def test_turning_the_thighs_in_stands_straight_on_flat_feet(tmp_path: Path, body: Body) -> None:
    joints = performer()
    values = still(joints)
    for name, degrees in (("LeftUpLeg", -20.0), ("RightUpLeg", 20.0)):
        index = [joint[0] for joint in joints].index(name)
        values[:, 6 + 3 * (index - 1)] = degrees
    result = retarget(clip_of(tmp_path, joints, values), body)
    for side in ("Left", "Right"):
        down = direction(result, f"{side}UpLeg", f"{side}Foot")
        torch.testing.assert_close(down, torch.tensor([0.0, 0.0, -1.0]).expand_as(down), atol=2e-2, rtol=0)
        foot = result.rotations[:, result.skeleton.names.index(f"{side}Foot")]
        torch.testing.assert_close(foot, torch.eye(3).expand_as(foot), atol=1e-5, rtol=0)
    torch.testing.assert_close(lowest_vertex(result, body), torch.zeros(3), atol=1e-5, rtol=0)


def test_the_unit_of_the_file_does_not_matter(tmp_path: Path, body: Body) -> None:
    joints = performer()
    values = moving(joints)
    larger = values.copy()
    larger[:, :3] *= 100.0
    scaled = [(name, parent, tuple(100.0 * x for x in offset), ch) for name, parent, offset, ch in joints]
    first = retarget(clip_of(tmp_path, joints, values), body)
    second = retarget(clip_of(tmp_path, scaled, larger), body)
    torch.testing.assert_close(second.rotations, first.rotations, atol=1e-5, rtol=0)
    torch.testing.assert_close(second.translation, first.translation, atol=1e-4, rtol=0)


@pytest.mark.parametrize("axes", [[[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]])
def test_the_axes_of_the_file_do_not_matter(tmp_path: Path, axes: list[list[int]], body: Body) -> None:
    joints = performer()
    clip = clip_of(tmp_path, joints, moving(joints))
    turn = torch.tensor(axes, dtype=torch.float32)
    turned = replace(
        clip,
        skeleton=replace(clip.skeleton, heads=clip.skeleton.heads @ turn.T),
        rotations=turn @ clip.rotations @ turn.T,
        translation=clip.translation @ turn.double().T,
    )
    first, second = retarget(clip, body), retarget(turned, body)
    torch.testing.assert_close(second.rotations, first.rotations, atol=1e-5, rtol=0)
    torch.testing.assert_close(second.translation, first.translation, atol=1e-5, rtol=0)


def test_a_rotated_root_turns_the_whole_clip(tmp_path: Path, body: Body) -> None:
    joints = performer()
    clip = clip_of(tmp_path, joints, moving(joints))
    about_y = torch.from_numpy(Rotation.from_euler("y", 0.7).as_matrix()).float()
    about_z = torch.from_numpy(Rotation.from_euler("z", 0.7).as_matrix()).float()
    turned = replace(
        clip, rotations=about_y @ clip.rotations, translation=clip.translation @ about_y.double().T
    )
    first, second = retarget(clip, body), retarget(turned, body)
    torch.testing.assert_close(second.rotations, about_z @ first.rotations, atol=1e-5, rtol=0)
    torch.testing.assert_close(second.translation, first.translation @ about_z.double().T, atol=1e-5, rtol=0)


def test_limbs_point_where_the_performers_do_and_the_path_is_scaled_by_the_legs(
    tmp_path: Path, body: Body
) -> None:
    joints = performer()
    clip = clip_of(tmp_path, joints, moving(joints))
    result = retarget(clip, body)
    to_body = torch.tensor([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    for start, end in (("LeftArm", "LeftForeArm"), ("RightForeArm", "RightHand"), ("LeftLeg", "LeftFoot")):
        performed = direction(clip, start, end) @ to_body.T
        torch.testing.assert_close(direction(result, start, end), performed, atol=1e-5, rtol=0)
    legs = posed(result, "LeftUpLeg", "LeftLeg", "LeftFoot")[0]
    scale = (legs[1:] - legs[:-1]).norm(dim=-1).sum() / (17.0 + 16.0)
    middle = posed(result, "LeftUpLeg", "RightUpLeg").mean(1)
    path = scale * posed(clip, "LeftUpLeg", "RightUpLeg").mean(1) @ to_body.T
    torch.testing.assert_close(middle - middle[0], path - path[0], atol=1e-4, rtol=0)


def test_resampling_120_to_30_keeps_the_poses(tmp_path: Path, body: Body) -> None:
    joints = performer()
    clip = clip_of(tmp_path, joints, moving(joints, frames=42), fps=120.0)
    slower = resample(clip, 30.0)
    assert (slower.fps, len(slower)) == (30.0, 11)
    torch.testing.assert_close(slower.rotations, clip.rotations[::4], atol=1e-5, rtol=0)
    torch.testing.assert_close(slower.translation, clip.translation[::4], atol=1e-5, rtol=0)
    retargeted = retarget(clip, body, fps=30.0)
    torch.testing.assert_close(
        retargeted.rotations, retarget(clip, body, fps=120.0).rotations[::4], atol=1e-5, rtol=0
    )


@pytest.mark.parametrize("fps", [0.0, -5.0, 0.99, 1000.5, 1e9, float("nan"), float("inf")])
def test_a_frame_rate_that_no_motion_has_is_refused_at_once(tmp_path: Path, body: Body, fps: float) -> None:
    joints = performer()
    clip = clip_of(tmp_path, joints, still(joints))
    for brought in (lambda: resample(clip, fps), lambda: retarget(clip, body, fps)):
        with pytest.raises(
            InputError, match=re.escape(f"--fps {fps:g}: expected 1 to 1000 frames per second")
        ):
            brought()


@pytest.mark.parametrize(("fps", "frames"), [(1.0, 2), (1000.0, 1001)])
def test_the_ends_of_the_range_are_frame_rates(tmp_path: Path, fps: float, frames: int) -> None:
    joints = performer()
    assert len(resample(clip_of(tmp_path, joints, still(joints, frames=31)), fps)) == frames


def test_resampling_between_frames_is_half_the_turn(tmp_path: Path) -> None:
    joints = performer()
    values = still(joints, frames=2)
    values[1, 3] = 90.0
    values[1, 0] = 4.0
    middle = resample(clip_of(tmp_path, joints, values), 60.0)
    expected = torch.from_numpy(Rotation.from_euler("z", 45.0, degrees=True).as_matrix()).float()
    assert len(middle) == 3
    torch.testing.assert_close(middle.rotations[1, 0], expected, atol=1e-6, rtol=0)
    assert middle.translation[1, 0] == pytest.approx(2.0)


def test_one_frame_resamples_to_one_frame(tmp_path: Path, body: Body) -> None:
    joints = performer()
    assert len(retarget(clip_of(tmp_path, joints, still(joints, 1), fps=24.0), body)) == 1


def test_smallest_rotation_takes_one_direction_to_the_other() -> None:
    source, target = (torch.nn.functional.normalize(v, dim=0) for v in torch.randn(2, 3).double())
    turn = smallest_rotation(source, target)
    torch.testing.assert_close(turn @ source, target)
    torch.testing.assert_close(turn @ turn.T, torch.eye(3).double())
    cosine = (turn.trace() - 1) / 2
    torch.testing.assert_close(cosine, source @ target)


FAMILIES = {
    "MotionBuilder": """
        Hips=hips LHipJoint=- LeftUpLeg=left_thigh LeftLeg=left_shin LeftFoot=left_foot LeftToeBase=left_toes
        LowerBack=lower_spine Spine=middle_spine Spine1=upper_spine Neck=lower_neck Neck1=upper_neck Head=head
        LeftShoulder=left_clavicle LeftArm=left_upper_arm LeftForeArm=left_forearm LeftHand=left_hand
        LeftHandIndex1=left_fingers LThumb=-""",
    "3ds Max": """
        Hips=hips LHipJoint=- LeftHip=left_thigh LeftKnee=left_shin LeftAnkle=left_foot LeftToe=left_toes
        lowerback=lower_spine Chest=middle_spine Chest2=upper_spine lowerneck=lower_neck Neck=upper_neck
        Head=head LeftCollar=left_clavicle LeftShoulder=left_upper_arm LeftElbow=left_forearm
        LeftWrist=left_hand lhand=- LFingers=left_fingers""",
    "DAZ": """
        hip=hips abdomen=lower_spine chest=middle_spine neck=lower_neck head=head leftEye=-
        rCollar=right_clavicle rShldr=right_upper_arm rForeArm=right_forearm rHand=right_hand
        rMid1=right_fingers rButtock=- rThigh=right_thigh rShin=right_shin rFoot=right_foot""",
    "Mixamo": """
        mixamorig:Hips=hips mixamorig:Spine=lower_spine mixamorig:Spine1=middle_spine
        mixamorig:Spine2=upper_spine mixamorig:Neck=lower_neck mixamorig:Head=head
        mixamorig:RightShoulder=right_clavicle mixamorig:RightArm=right_upper_arm
        mixamorig:RightUpLeg=right_thigh mixamorig:RightToeBase=right_toes""",
}


@pytest.mark.parametrize("family", FAMILIES)
def test_every_naming_family_is_known(family: str) -> None:
    expected = dict(pair.split("=") for pair in FAMILIES[family].split())
    names = list(expected)
    roles = {index: role for role, index in joint_roles(names).items()}
    assert {name: roles.get(i, "-") for i, name in enumerate(names)} == expected


@pytest.mark.parametrize("prefix", ["mixamorig:", "mixamorig", "Armature:", "mixamorig:".upper()])
def test_a_prefix_of_the_names_changes_nothing(tmp_path: Path, prefix: str, body: Body) -> None:
    joints = performer()
    clip = clip_of(tmp_path, joints, moving(joints))
    names = tuple(prefix + name for name in clip.skeleton.names)
    renamed = replace(clip, skeleton=replace(clip.skeleton, names=names))
    torch.testing.assert_close(retarget(renamed, body).rotations, retarget(clip, body).rotations)


def test_unknown_joints_are_refused_by_name(tmp_path: Path, body: Body) -> None:
    joints = performer()
    renamed = [(name.replace("RightLeg", "Wheel"), *rest) for name, *rest in joints]
    with pytest.raises(InputError, match=r"clip capture: unknown joint set.*right shin"):
        retarget(clip_of(tmp_path, renamed, still(joints)), body)


@every_capture
def test_captures_retarget_and_left_stays_left(path: Path, body: Body) -> None:
    capture = read_bvh(path)
    thinned = replace(capture, rotations=capture.rotations[::EVERY], translation=capture.translation[::EVERY])
    clip = retarget(thinned, body)
    assert len(clip) == len(thinned)
    assert torch.isfinite(clip.rotations).all()
    assert torch.isfinite(clip.translation).all()
    identity = clip.rotations.mT @ clip.rotations
    torch.testing.assert_close(identity, torch.eye(3).expand_as(identity), atol=1e-4, rtol=0)

    source, target = (
        {role: skeleton.names[i] for role, i in skeleton.roles.items()}
        for skeleton in (thinned.skeleton, clip.skeleton)
    )
    thigh, foot = (thinned.skeleton.names.index(source[f"left_{joint}"]) for joint in ("thigh", "foot"))
    leg = (thinned.skeleton.heads[thigh] - thinned.skeleton.heads[foot]).norm()
    for end in ("hand", "foot"):
        performed, carried = (across(c, names, end) for c, names in ((thinned, source), (clip, target)))
        assert carried.median() > 0
        clearly = performed > 0.2 * leg
        assert (carried[clearly] > 0).all()


def across(clip: Clip, names: dict[str, str], end: str) -> Tensor:
    """How far the left hand or foot is to the left of the right one, along the line of the hip joints."""
    points = posed(
        clip, *(names[f"{side}_{joint}"] for joint in ("thigh", end) for side in ("left", "right"))
    )
    left = torch.nn.functional.normalize(points[:, 0] - points[:, 1], dim=-1)
    return ((points[:, 2] - points[:, 3]) * left).sum(-1)


@pytest.mark.parametrize("name", ["12_01", "02_01"])
def test_walks_stay_within_5_cm_of_the_floor(name: str, mocap_folder: Path, body: Body) -> None:
    clip = retarget(read_bvh(mocap_folder / "cmu" / f"{name}.bvh"), body)
    assert lowest_vertex(clip, body).abs().max() < 0.05
