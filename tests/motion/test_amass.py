"""Motions of AMASS: made-up files in its old and new fields, on bodies of SMPL's and on ours."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from tests.bodies.smpl_file import smpl_arrays, smpl_vertices, write_npz
from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.bodies.smpl import read_smpl
from uvcloth.commands.motion import DescribeMotion
from uvcloth.commands.run.motion import run
from uvcloth.errors import InputError
from uvcloth.motion.library import load_clip, read_motion
from uvcloth.motion.options import MotionOptions
from uvcloth.motion.retarget import lowest_vertex

Arrays = dict[str, Any]

STAND = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From Y up, facing +Z, to Z up, facing -Y."""


def motion(joints: int = 52, frames: int = 41, fps: float = 120.0) -> Arrays:
    """A person who stands, sways by turns of one axis a joint, and moves ahead."""
    t = np.arange(frames) / fps
    rng = np.random.default_rng(2)
    poses = 0.15 * np.sin(4.0 * t)[:, None, None] * rng.standard_normal((joints, 3))
    poses[:, 0] = [0.5 * np.pi, 0.0, 0.0]
    return {
        "poses": poses.reshape(frames, -1),
        "trans": np.stack([0.1 * t, -1.2 * t, 1.0 + 0.0 * t], axis=1),
        "betas": np.zeros(16),
        "gender": np.array("female"),
        "mocap_framerate": np.array(fps),
        "dmpls": np.zeros((frames, 8)),
    }


def newer(old: Arrays) -> Arrays:
    """The same motion with the fields of newer files."""
    poses = old["poses"]
    face = np.zeros((len(poses), 9))
    return {
        "surface_model_type": np.array("smplx"),
        "mocap_frame_rate": old["mocap_framerate"],
        "trans": old["trans"],
        "betas": old["betas"],
        "root_orient": poses[:, :3],
        "pose_body": poses[:, 3:66],
        "pose_hand": poses[:, 66:],
        "pose_jaw": face[:, :3],
        "pose_eye": face[:, 3:],
        "latent_labels": np.array(["a", None], dtype=object),
    }


def write(path: Path, arrays: Arrays) -> Path:
    np.savez(path, **arrays)
    return path


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Arrays, Path]]:
    folder = tmp_path_factory.mktemp("models")
    arrays = {kind: smpl_arrays(kind, voxel=0.04) for kind in ("SMPL", "SMPL-H", "SMPL-X")}
    return {kind: (each, write_npz(folder / f"{kind}.npz", each)) for kind, each in arrays.items()}


@pytest.mark.parametrize("kind", ["SMPL", "SMPL-H", "SMPL-X"])
def test_on_a_body_of_smpls_the_surface_is_that_of_smpls_equations(
    kind: str, models: dict[str, tuple[Arrays, Path]], tmp_path: Path
) -> None:
    arrays, file = models[kind]
    betas = np.array([-0.5, 1.0])
    body = read_smpl(file).resting().body(torch.from_numpy(betas), unwrapped=False)
    found = motion()
    path = write(tmp_path / "sway.npz", newer(found) if kind == "SMPL-X" else found)
    clip = load_clip(path, body)
    assert (clip.fps, len(clip)) == (30.0, 11)
    posed = posed_skin(body, clip.transforms()).double().numpy()

    poses = found["poses"].reshape(41, 52, 3)
    parts = {
        "SMPL": [poses[:, :22], np.zeros((41, 2, 3))],
        "SMPL-H": [poses],
        "SMPL-X": [poses[:, :22], np.zeros((41, 3, 3)), poses[:, 22:]],
    }
    whole = np.concatenate(parts[kind], axis=1)
    used = np.unique(arrays["f"]) if len(body.mesh.vertices) == len(arrays["v_template"]) else None
    assert used is not None, "the made-up body is one piece"
    off = []
    for frame in (0, 5, 10):
        expected, _ = smpl_vertices(arrays, betas, whole[4 * frame], found["trans"][4 * frame])
        off.append(posed[frame] - expected)
    # The floor moves all frames up or down by the same; all else is the file's own world.
    off = np.array(off) - [0.0, 0.0, np.array(off)[0, 0, 2]]
    assert np.abs(off).max() < 2e-5
    assert abs(float(lowest_vertex(clip, body).quantile(0.15))) < 0.01


def test_old_and_new_fields_are_one_motion(tmp_path: Path) -> None:
    old = read_motion(write(tmp_path / "old.npz", motion()))
    new = read_motion(write(tmp_path / "new.npz", newer(motion())))
    assert (old.fps, new.fps, len(old.skeleton.names), len(new.skeleton.names)) == (120.0, 120.0, 52, 55)
    for index, name in enumerate(old.skeleton.names):
        there = new.skeleton.names.index(name)
        torch.testing.assert_close(new.rotations[:, there], old.rotations[:, index], atol=1e-6, rtol=0)
    torch.testing.assert_close(new.translation, old.translation)
    body_only = {
        key: newer(motion())[key] for key in ("root_orient", "pose_body", "trans", "mocap_frame_rate")
    }
    assert len(read_motion(write(tmp_path / "few.npz", body_only)).skeleton.names) == 22


def test_on_our_body_limbs_point_where_the_file_says(tmp_path: Path, body: Body) -> None:
    arrays = motion(frames=4, fps=30.0)
    poses = np.zeros((4, 52, 3))
    poses[:, 0] = [0.5 * np.pi, 0.0, 0.0]
    poses[1, 18] = [0.0, -0.5 * np.pi, 0.0]  # the left elbow, forearm forwards
    poses[2, 2] = [-0.5 * np.pi, 0.0, 0.0]  # the right hip, thigh forwards
    poses[3, 0] = [0.5 * np.pi, 0.0, 0.0]
    poses[3, 17] = [0.0, 0.0, 0.5 * np.pi]  # the right shoulder, arm down
    clip = load_clip(write(tmp_path / "t.npz", {**arrays, "poses": poses.reshape(4, -1)}), body)
    roles = body.skeleton.roles
    positions = clip.positions()

    def bone(frame: int, start: str, end: str) -> torch.Tensor:
        way = positions[frame, roles[end]] - positions[frame, roles[start]]
        return way / way.norm()

    for frame, start, end, wanted in (
        (0, "left_upper_arm", "left_forearm", (1, 0, 0)),
        (0, "right_forearm", "right_hand", (-1, 0, 0)),
        (0, "left_thigh", "left_shin", (0, 0, -1)),
        (1, "left_upper_arm", "left_forearm", (1, 0, 0)),
        (1, "left_forearm", "left_hand", (0, -1, 0)),
        (2, "right_thigh", "right_shin", (0, -1, 0)),
        (2, "left_thigh", "left_shin", (0, 0, -1)),
        (3, "right_upper_arm", "right_forearm", (0, 0, -1)),
    ):
        assert float(bone(frame, start, end).float() @ torch.tensor(wanted).float()) > 0.99, (frame, start)


def test_the_command_describes_and_draws_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path / "sway.npz", motion())
    run(DescribeMotion(str(tmp_path / "sway.npz"), tmp_path / "sheet.png", options=MotionOptions()))
    printed = capsys.readouterr().out
    assert "sway: 41 frames at 120 per second" in printed
    assert "SMPL names, 52 joints" in printed
    assert "rest pose: the zero pose; up: +z" in printed
    assert (tmp_path / "sheet.png").exists()


class Shell:
    def __init__(self, command: str) -> None:
        self.command = command

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (self.command,)


Damage = Callable[[Arrays], Arrays]

FAULTS: dict[str, Damage] = {
    r"poses has the shape \(41, 63\), expected .* 72 \(SMPL\), 156 \(SMPL-H\), 165": lambda a: {
        **a, "poses": a["poses"][:, :63]
    },
    "holds no poses, lacks root_orient, pose_body": lambda a: {"betas": a["betas"], "gender": a["gender"]},
    "lacks trans": lambda a: {key: a[key] for key in ("poses", "mocap_framerate")},
    "lacks mocap_framerate": lambda a: {key: a[key] for key in ("poses", "trans")},
    "trans has the shape": lambda a: {**a, "trans": a["trans"][:-1]},
    "trans holds a value that is not a finite number in frame 7": lambda a: {**a, "trans": hole(a["trans"])},
    "poses holds a value that is not a finite number in frame 7": lambda a: {**a, "poses": hole(a["poses"])},
    "mocap_framerate is 0": lambda a: {**a, "mocap_framerate": np.array(0.0)},
    "has no frames": lambda a: {**a, "poses": a["poses"][:0], "trans": a["trans"][:0]},
    "trans holds no numbers": lambda a: {**a, "trans": np.array(["x"])},
    r"pose_hand has the shape \(41, 12\)": lambda a: {**newer(a), "pose_hand": a["poses"][:, :12]},
}  # fmt: skip


def hole(values: np.ndarray) -> np.ndarray:
    values = values.copy()
    values[7, 1] = np.nan
    return values


@pytest.mark.parametrize("said", FAULTS)
def test_a_faulty_file_is_one_sentence(tmp_path: Path, said: str) -> None:
    path = write(tmp_path / "faulty.npz", FAULTS[said](motion()))
    with pytest.raises(InputError, match=rf"faulty\.npz: .*{said}") as caught:
        read_motion(path)
    assert "\n" not in str(caught.value)


def test_damaged_and_pickled_files_are_one_sentence_and_nothing_runs(tmp_path: Path) -> None:
    path = write(tmp_path / "walk.npz", motion())
    path.write_bytes(path.read_bytes()[:4000])
    with pytest.raises(InputError, match=r"walk\.npz: not a readable npz"):
        read_motion(path)
    ran = tmp_path / "ran"
    evil = np.array([Shell(f"touch {ran}")], dtype=object)
    with pytest.raises(InputError, match=r"evil\.npz: poses is pickled.*nothing is unpickled"):
        read_motion(write(tmp_path / "evil.npz", {**motion(), "poses": evil}))
    assert not ran.exists()
    np.savez(tmp_path / "other.npz", things=np.zeros(3))
    with pytest.raises(InputError, match=r"other\.npz: expected a motion clip saved by uvcloth"):
        read_motion(tmp_path / "other.npz")
