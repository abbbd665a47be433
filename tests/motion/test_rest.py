"""Rest poses and options that decide over a motion, and motions that no person can have made."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from scipy.spatial.transform import Rotation

from tests.motion.bvh_text import performer
from tests.motion.families import FAMILIES
from tests.motion.layouts import ROLES, difference, write_layout
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.roles import joint_roles
from uvcloth.motion.clip import Clip
from uvcloth.motion.lead_in import pose_from_rest
from uvcloth.motion.library import load_clip, load_source, save_clip
from uvcloth.motion.options import MotionOptions
from uvcloth.motion.posture import check_posture
from uvcloth.motion.rest import ZERO_POSE, rebase, standing_axis


@pytest.fixture(scope="module")
def walk(body: Body) -> Clip:
    return load_clip("walk", body).window(20, 45)


def with_stand(walk: Clip, heading: float, lean: float = 0.0) -> Clip:
    """The walk after one frame of standing at rest, turned about the vertical after a lean to the side."""
    turn = torch.from_numpy(Rotation.from_euler("yz", [lean, heading]).as_matrix()).float()
    stand = turn.expand(1, *walk.rotations.shape[1:])
    return replace(
        walk,
        rotations=torch.cat([stand, walk.rotations]),
        translation=torch.cat([walk.translation[:1], walk.translation]),
    )


def test_a_named_frame_is_the_rest_pose_whatever_its_heading(walk: Clip, tmp_path: Path, body: Body) -> None:
    layout = replace(FAMILIES["MotionBuilder"], zero="random")
    path = tmp_path / "walk.bvh"
    write_layout(with_stand(walk, 0.6), layout, path)
    found = load_clip(path, body, MotionOptions(rest_frame=0, frames="1:"))
    gap = difference(found, walk, layout.names())
    assert gap.degrees < 6.0, gap
    assert gap.centimetres < 1.0, gap


def test_a_named_frame_is_turned_about_the_vertical_alone(walk: Clip, tmp_path: Path, body: Body) -> None:
    path = tmp_path / "walk.bvh"
    write_layout(with_stand(walk, 0.6, lean=0.1), FAMILIES["MotionBuilder"], path)
    rest = load_source(path, body, MotionOptions(rest_frame=0)).rest.clip.skeleton
    left, right = (rest.heads[rest.names.index(f"{side}UpLeg")] for side in ("Left", "Right"))
    across = (left - right) / (left - right).norm()
    torch.testing.assert_close(across, torch.tensor([math.cos(0.1), -math.sin(0.1), 0.0]), atol=1e-3, rtol=0)


def test_shins_whose_axes_are_turned_in_the_file_are_not_taken_for_untwisted(
    walk: Clip, tmp_path: Path, body: Body
) -> None:
    path, layout = tmp_path / "walk.bvh", replace(FAMILIES["Rokoko"], zero="twisted")
    write_layout(walk, layout, path)
    gap = difference(load_clip(path, body), walk, layout.names())
    assert gap.degrees < 25.0, gap


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (MotionOptions(rest_frame=45), "--rest-frame 45: the file has the frames 0 to 44"),
        (MotionOptions(rest_frame=8), "--rest-frame 8: the person does not stand upright in it"),
        (MotionOptions(frames="50:60"), "--frames 50:60: expected A:B within the motion's 45 frames"),
        (MotionOptions(frames="7"), "--frames 7: expected A:B"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    walk: Clip, tmp_path: Path, body: Body, options: MotionOptions, sentence: str
) -> None:
    path = tmp_path / "walk.bvh"
    crouching = turned_joint(walk, 8, ("LeftUpLeg", "RightUpLeg"), -1.5)
    write_layout(crouching, FAMILIES["MotionBuilder"], path)
    with pytest.raises(InputError, match=rf"walk\.bvh: {sentence}"):
        load_clip(path, body, options)


@pytest.mark.parametrize(
    ("joints", "sentence"),
    [
        (
            ("UpLeg", "Leg", "Foot", "ToeBase", "Shoulder", "Arm", "ForeArm", "Hand"),
            "knees bend backwards in",
        ),
        (("UpLeg", "Leg", "Foot", "ToeBase"), "left arm and left leg are on one side in only 0%"),
    ],
)
def test_exchanged_sides_are_refused(
    walk: Clip, tmp_path: Path, body: Body, joints: tuple[str, ...], sentence: str
) -> None:
    path = tmp_path / "walk.bvh"
    write_layout(walk, FAMILIES["MotionBuilder"], path)
    text = path.read_text()
    for joint in joints:
        text = text.replace(f"Left{joint}\n", "?\n").replace(f"Right{joint}\n", f"Left{joint}\n")
        text = text.replace("?\n", f"Right{joint}\n")
    path.write_text(text)
    with pytest.raises(InputError, match=sentence):
        load_clip(path, body)


def test_who_lies_is_refused_unless_the_axis_is_named(walk: Clip, tmp_path: Path, body: Body) -> None:
    path = tmp_path / "walk.bvh"
    down = torch.from_numpy(Rotation.from_euler("x", -90, degrees=True).as_matrix()).float()
    away = walk.translation @ down.T + torch.tensor([0.0, 3.0, 0.0])
    write_layout(replace(walk, rotations=down @ walk.rotations, translation=away), FAMILIES["CMU"], path)
    with pytest.raises(InputError, match=r"hips below the head in only .*--up y"):
        load_clip(path, body)
    lying = load_clip(path, body, MotionOptions(up="y"))
    torch.testing.assert_close(lying.rotations[:, 0], down @ walk.rotations[:, 0], atol=1e-3, rtol=0)


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_first_frame_in_place_of_the_rest_pose_is_none(
    walk: Clip, tmp_path: Path, body: Body, turn: float
) -> None:
    """As in animations of Ready Player Me: the person stands there, but in the middle of a step."""
    about = torch.from_numpy(Rotation.from_euler("z", turn).as_matrix()).float()
    turned = replace(walk, rotations=about @ walk.rotations, translation=walk.translation @ about.T)
    save_clip(rebase(turned, turned.rotations[0]), tmp_path / "step.npz")
    heads = load_source(tmp_path / "step.npz", body).clip.skeleton.heads
    assert standing_axis(heads, walk.skeleton.roles) is not None
    source = load_source(tmp_path / "step.npz", body)
    assert source.rest.origin == "the motion"
    gap = difference(load_clip(tmp_path / "step.npz", body), turned, dict.fromkeys(ROLES.values(), ""))
    assert gap.degrees < 30.0, gap  # Of hands, which hardly turn in a walk: how they rest is a mean.


def test_the_rest_pose_of_every_family_that_stands_is_taken(walk: Clip, tmp_path: Path, body: Body) -> None:
    for name in ("MotionBuilder", "DAZ Genesis 8", "3ds Max Biped", "VRM"):
        write_layout(walk, FAMILIES[name], tmp_path / "walk.bvh")
        assert load_source(tmp_path / "walk.bvh", body).rest.origin == ZERO_POSE, name


def test_who_sits_cross_legged_bends_the_knees_forwards(walk: Clip) -> None:
    clip = walk.window(0, 4)
    rotations = torch.eye(3).expand_as(clip.rotations).clone()
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        thigh, shin = (clip.skeleton.names.index(f"{side}{name}") for name in ("UpLeg", "Leg"))
        # The thigh forwards and outwards, turned about itself until the knee is beside and the shin inside.
        out = Rotation.from_euler("zxz", [sign * 115.0, -80.0, sign * 25.0], degrees=True)
        bent = out * Rotation.from_euler("x", 120.0, degrees=True)
        rotations[:, thigh] = torch.from_numpy(out.as_matrix()).float()
        rotations[:, clip.skeleton.branch(shin)] = torch.from_numpy(bent.as_matrix()).float()
    sitting = replace(clip, rotations=rotations)
    check_posture(sitting, lying=True)
    backwards = rotations.clone()
    for side in ("Left", "Right"):
        shin = clip.skeleton.names.index(f"{side}Leg")
        thigh = clip.skeleton.parents[shin]
        backwards[:, clip.skeleton.branch(shin)] = (
            rotations[:, thigh] @ (rotations[:, thigh].mT @ rotations[:, shin]).mT
        )[:, None]
    with pytest.raises(InputError, match="knees bend backwards in 100%"):
        check_posture(replace(clip, rotations=backwards), lying=True)


def test_a_named_axis_turns_a_standing_rest_pose(walk: Clip, tmp_path: Path, body: Body) -> None:
    layout = FAMILIES["Y-up rest, Z-up motion"]
    path = tmp_path / "walk.bvh"
    write_layout(replace(walk, translation=walk.translation + torch.tensor([0.0, 0.0, 5.0])), layout, path)
    with pytest.raises(InputError, match="--up z"):
        load_clip(path, body)
    assert load_source(path, body, MotionOptions(up="z")).rest.up == "+z"
    gap = difference(load_clip(path, body, MotionOptions(up="z")), walk, layout.names())
    assert gap.degrees < 6.0, gap


def test_frames_rate_and_place_are_options(walk: Clip, tmp_path: Path, body: Body) -> None:
    path = tmp_path / "walk.bvh"
    write_layout(walk, FAMILIES["MotionBuilder"], path)
    whole = load_clip(path, body)
    part = load_clip(path, body, MotionOptions(frames="10:-5", in_place=True))
    torch.testing.assert_close(part.rotations, whole.rotations[10:-5])
    torch.testing.assert_close(part.translation[:, 2], whole.translation[10:-5, 2])
    assert not part.translation[:, :2].any()
    faster = load_clip(path, body, MotionOptions(fps=60.0))
    assert (faster.fps, len(faster)) == (60.0, 89)
    torch.testing.assert_close(faster.rotations[::2], whole.rotations, atol=1e-5, rtol=0)


def test_one_frame_is_a_pose_that_is_moved_into_from_rest(walk: Clip, tmp_path: Path, body: Body) -> None:
    path = tmp_path / "pose.bvh"
    write_layout(walk.window(10, 1), FAMILIES["MotionBuilder"], path)
    pose = load_clip(path, body)
    moving = pose_from_rest(pose, body)
    assert len(pose) == 1
    assert len(moving) > 30
    torch.testing.assert_close(moving.rotations[-18:], pose.rotations.expand(18, -1, -1, -1))
    resting = moving.rotations[0, :1].expand_as(moving.rotations[0])
    torch.testing.assert_close(moving.rotations[0], resting)
    assert (moving.rotations[1:] - moving.rotations[:-1]).abs().max() < 0.2
    assert pose_from_rest(walk, body) is walk


def test_latin_1_is_text(walk: Clip, tmp_path: Path, body: Body) -> None:
    layout = FAMILIES["Mixamo, other prefix"]
    accented = replace(
        layout, middle=layout.middle.replace("Pal", "Pål"), sides=layout.sides.replace("Pal", "Pål")
    )
    write_layout(walk, accented, tmp_path / "walk.bvh")
    with pytest.raises(UnicodeDecodeError):
        (tmp_path / "walk.bvh").read_text(encoding="utf-8")
    assert difference(load_clip(tmp_path / "walk.bvh", body), walk, layout.names()).degrees < 6.0


def test_the_shipped_motions_are_how_people_move(body: Body) -> None:
    for name in ("run", "spin", "jump"):
        check_posture(load_clip(name, body))


def turned_joint(clip: Clip, frame: int, names: tuple[str, ...], angle: float) -> Clip:
    """The clip with joints, and all that hangs on them, turned about the x axis in one frame."""
    turn = torch.from_numpy(Rotation.from_euler("x", angle).as_matrix()).float()
    turned = {clip.skeleton.names.index(name) for name in names}
    for joint, parent in enumerate(clip.skeleton.parents):
        if parent in turned:
            turned.add(joint)
    rotations = clip.rotations.clone()
    rotations[frame, sorted(turned)] = turn @ rotations[frame, sorted(turned)]
    return replace(clip, rotations=rotations)


def test_hips_may_tilt_while_arms_hang_down() -> None:
    """Sideways is level, however much higher one thigh is."""
    joints = performer(arms_down=True)
    heads = torch.zeros(len(joints), 3)
    for index, (_, parent, offset, _) in enumerate(joints[1:], start=1):
        heads[index] = heads[parent] + torch.tensor(offset)
    roles = joint_roles([joint[0] for joint in joints])
    for side, raised in (("left", 1.6), ("right", -1.6)):
        heads[[roles[f"{side}_{part}"] for part in ("thigh", "shin", "foot")], 1] += raised
    assert standing_axis(heads, roles).tolist() == [0.0, 1.0, 0.0]
