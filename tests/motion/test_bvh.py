from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.motion.bvh_text import CHANNELS, ROOT_CHANNELS, Joint, bvh_text, performer, still
from uvcloth.errors import InputError
from uvcloth.motion.bvh import read_bvh

QUICK = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@st.composite
def captures(draw: st.DrawFn) -> tuple[list[Joint], np.ndarray]:
    """A random tree of joints with its own channel order each, and random motion."""
    orders = st.permutations(CHANNELS).map(tuple)
    offset = st.tuples(*[st.integers(-9, 9).map(float)] * 3)
    joints: list[Joint] = [("root", -1, draw(offset), ROOT_CHANNELS[:3] + draw(orders))]
    branch = [0]
    for index in range(1, draw(st.integers(1, 6))):
        branch = branch[: draw(st.integers(1, len(branch)))]
        joints.append((f"joint{index}", branch[-1], draw(offset), draw(orders)))
        branch.append(index)
    columns = sum(len(joint[3]) for joint in joints)
    seed = draw(st.integers(0, 2**32 - 1))
    values = np.random.default_rng(seed).uniform(-180, 180, (draw(st.integers(1, 4)), columns))
    return joints, values.round(6)


def turn(axis: str, degrees: float) -> np.ndarray:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    matrix = np.eye(4)
    first, second = {"X": (1, 2), "Y": (2, 0), "Z": (0, 1)}[axis]
    matrix[first, first] = matrix[second, second] = c
    matrix[second, first], matrix[first, second] = s, -s
    return matrix


def posed_heads(joints: list[Joint], row: np.ndarray) -> np.ndarray:
    """Forward kinematics as the format describes it, one 4 x 4 matrix per channel."""
    world: list[np.ndarray] = []
    column = 0
    for _, parent, offset, channels in joints:
        shift = np.eye(4)
        shift[:3, 3] = offset
        rotation = np.eye(4)
        for channel in channels:
            value = row[column]
            column += 1
            if channel.endswith("position"):
                shift["XYZ".index(channel[0]), 3] = value
            else:
                rotation = rotation @ turn(channel[0], value)
        local = shift @ rotation
        world.append(local if parent < 0 else world[parent] @ local)
    return np.array([matrix[:3, 3] for matrix in world])


@QUICK
@given(capture=captures())
def test_joints_are_where_the_format_puts_them(
    tmp_path: Path, capture: tuple[list[Joint], np.ndarray]
) -> None:
    joints, values = capture
    path = tmp_path / "capture.bvh"
    path.write_text(bvh_text(joints, values))

    clip = read_bvh(path)

    assert clip.name == "capture"
    assert clip.skeleton.names == tuple(joint[0] for joint in joints)
    assert clip.skeleton.parents == tuple(joint[1] for joint in joints)
    heads = clip.skeleton.heads
    transforms = clip.transforms()
    posed = (transforms[..., :3] @ heads[:, :, None]).squeeze(-1) + transforms[..., 3]
    truth = np.stack([posed_heads(joints, row) for row in values])
    np.testing.assert_allclose(posed.numpy(), truth, atol=2e-4)


@QUICK
@given(share=st.floats(0, 1))
def test_a_truncated_file_is_refused(tmp_path: Path, share: float) -> None:
    joints = performer()
    text = bvh_text(joints, still(joints))
    path = tmp_path / "cut.bvh"
    path.write_text(text[: int(share * text.rindex(" "))])
    with pytest.raises(InputError, match=r"cut\.bvh"):
        read_bvh(path)


@QUICK
@given(data=st.data(), bad=st.sampled_from(["nan", "inf", "-inf", "1e999"]))
def test_a_value_that_is_not_finite_is_named(tmp_path: Path, data: st.DataObject, bad: str) -> None:
    joints = performer()
    lines = bvh_text(joints, still(joints)).splitlines()
    frame = data.draw(st.integers(0, 2))
    joint = data.draw(st.integers(1, len(joints) - 1))
    number = len(lines) - 3 + frame
    words = lines[number].split()
    words[6 + 3 * (joint - 1)] = bad
    lines[number] = " ".join(words)
    path = tmp_path / "bad.bvh"
    path.write_text("\n".join(lines))
    place = rf"bad\.bvh, line {number + 1}: frame {frame}, joint {joints[joint][0]}: zrotation"
    with pytest.raises(InputError, match=place):
        read_bvh(path)


@QUICK
@given(data=st.data(), word=st.text(alphabet="{}-.:0123456789eROTJINxyzMnaf \n", max_size=8))
def test_a_damaged_word_gives_a_clip_or_the_one_error(tmp_path: Path, data: st.DataObject, word: str) -> None:
    joints = performer()
    words = bvh_text(joints, still(joints)).split(" ")
    words[data.draw(st.integers(0, len(words) - 1))] = word
    path = tmp_path / "damaged.bvh"
    path.write_text(" ".join(words))
    with suppress(InputError):
        assert torch.isfinite(read_bvh(path).rotations).all()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("Frames: 3", "Frames: 0", "zero frames"),
        ("Frames: 3", "Frames: 5", "expected 5 frames, found 3"),
        ("Frames: 3", "Frames: many", "Frames"),
        ("Frame Time: 0.0333333", "Frame Time: nan", "frame time is nan"),
        ("Frame Time: 0.0333333", "Frame Time: 0", "frame time is 0.0 s, expected 0.0001 to 0.5 s"),
        ("Frame Time: 0.0333333", "Frame Time: inf", "frame time is inf s"),
        ("Frame Time: 0.0333333", "Frame Time: 1e-9", "frame time is 1e-09 s"),
        ("Frame Time: 0.0333333", "Frame Time: -0.0333333", "frame time is -0.0333333 s"),
        ("JOINT RightUpLeg", "JOINT LeftUpLeg", "two joints are named LeftUpLeg"),
        ("MOTION", "ROOT other\n{\nOFFSET 0 0 0\n}\nMOTION", "expected one ROOT"),
        ("OFFSET 4.0", "OFFSET four", "line 8"),
        ("OFFSET 4.0", "OFFSET nan", "line 8"),
        ("CHANNELS 3 Zrotation", "CHANNELS 4 Zrotation", "line 9"),
        ("CHANNELS 3 Zrotation", "CHANNELS 3 Wrotation", "line 9"),
        ("MOTION", "", "no MOTION"),
        ("Frames: 3", "Frames: 1000000000", "expected 1000000000 frames, found 3"),
        ("Frame Time: 0.0333333", "Frame Time: 10", "frame time is 10.0 s, expected 0.0001 to 0.5"),
        ("OFFSET 4.0", "OFFSET 1e39", "line 8"),
        ("JOINT RightUpLeg", "JOINT " + 300 * "x", "longer than 256"),
        ("OFFSET 0 1 0\n", "OFFSET 0 1 0\nCHANNELS 1 Xrotation\n", "line 25"),
        ("CHANNELS 3 Zrotation Yrotation Xrotation", "CHANNELS 3 Xposition Xposition Xrotation", "twice"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, old: str, new: str, said: str) -> None:
    joints = performer()
    text = bvh_text(joints, still(joints))
    assert old in text
    path = tmp_path / "wrong.bvh"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=rf"wrong\.bvh.*{said}"):
        read_bvh(path)


def test_a_value_that_single_precision_cannot_hold_is_named(tmp_path: Path) -> None:
    joints = performer()
    lines = bvh_text(joints, still(joints, frames=30)).splitlines()
    words = lines[-10].split()
    lines[-10] = " ".join([words[0], "1e39", *words[2:]])
    path = tmp_path / "far.bvh"
    path.write_text("\n".join(lines))
    place = rf"far\.bvh, line {len(lines) - 9}: frame 20, joint Hips: yposition is beyond 1e\+09"
    with pytest.raises(InputError, match=place):
        read_bvh(path)


def test_endless_nesting_is_refused_at_once(tmp_path: Path) -> None:
    count = 30_000
    joint = "JOINT j{}\n{{\nOFFSET 0 1 0\nCHANNELS 3 Zrotation Yrotation Xrotation\n"
    nested = "".join(joint.format(index) for index in range(count)) + count * "}\n"
    root = "HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Yrotation Xrotation\n"
    path = tmp_path / "deep.bvh"
    path.write_text(f"{root}{nested}}}\nMOTION\nFrames: 1\nFrame Time: 0.033\n{(3 * count + 3) * '0 '}\n")
    with pytest.raises(InputError, match=r"deep\.bvh: has more than 2,000 joints"):
        read_bvh(path)


def test_files_that_are_no_bvh(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_bvh(tmp_path / "absent.bvh")
    (tmp_path / "empty.bvh").write_text("")
    with pytest.raises(InputError, match=r"empty\.bvh"):
        read_bvh(tmp_path / "empty.bvh")
    (tmp_path / "binary.bvh").write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match=r"binary\.bvh.*not text"):
        read_bvh(tmp_path / "binary.bvh")


def test_a_joint_without_an_offset_is_at_its_parent(tmp_path: Path) -> None:
    joints = performer()
    text = bvh_text(joints, still(joints))
    assert text.count("OFFSET 0.0 2.0 0.0\n") == 1
    (tmp_path / "back.bvh").write_text(text.replace("OFFSET 0.0 2.0 0.0\n", ""))
    skeleton = read_bvh(tmp_path / "back.bvh").skeleton
    hips, back = (skeleton.heads[skeleton.names.index(name)] for name in ("Hips", "LowerBack"))
    assert torch.equal(hips, back)


def test_the_rounded_frame_time_of_120_fps_means_120(tmp_path: Path) -> None:
    joints = performer()
    path = tmp_path / "fast.bvh"
    path.write_text(bvh_text(joints, still(joints), seconds=0.0083333))
    assert read_bvh(path).fps == 120.0
