from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.motion.bvh_text import bvh_text, performer, still
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.files.archive import save_arrays
from uvcloth.geometry.skinning import skin
from uvcloth.motion.library import builtin_clips, load_clip, read_clip, save_clip
from uvcloth.motion.retarget import lowest_vertex

Damage = Callable[[np.ndarray], np.ndarray] | None


@pytest.mark.parametrize("name", builtin_clips())
def test_builtin_clips_load_on_the_body(name: str, body: Body) -> None:
    clip = load_clip(name, body)
    assert clip.fps == 30.0
    assert 30 <= len(clip) <= 150
    assert clip.skeleton is body.skeleton
    assert torch.isfinite(clip.transforms()).all()
    steps = (clip.translation[1:] - clip.translation[:-1]).norm(dim=1)
    assert steps.max() < 0.2


def test_there_are_three_clips_or_more_with_their_licence() -> None:
    clips = builtin_clips()
    assert len(clips) >= 3
    notice = (next(iter(clips.values())).parent / "NOTICE").read_text()
    assert "zlib" in notice
    for name in clips:
        assert name in notice


def test_the_builtin_walk_walks_forward_on_the_floor(body: Body) -> None:
    clip = load_clip("walk", body)
    heights = lowest_vertex(clip, body)
    assert heights.abs().max() < 0.05
    hips = clip.rotations[:, clip.skeleton.names.index("Hips")]
    velocity = (clip.translation[1:] - clip.translation[:-1]) * clip.fps
    ahead = -(velocity * hips[1:, :, 1]).sum(-1)
    assert 0.8 < ahead.mean() < 1.6
    assert 0.7 < clip.translation[:, 2].mean() < 1.1


def test_lowest_vertex_is_that_of_the_skinned_body(body: Body) -> None:
    clip = load_clip("dance", body).window(10, 4)
    vertices = skin(body.mesh.vertices, body.weights, clip.transforms())
    torch.testing.assert_close(lowest_vertex(clip, body), vertices[..., 2].amin(1), atol=1e-5, rtol=0)


def test_a_clip_saves_and_loads(tmp_path: Path) -> None:
    clip = read_clip(builtin_clips()["spin"])
    save_clip(clip, tmp_path / "spin.npz", notice="a test")
    again = read_clip(tmp_path / "spin.npz")
    assert (again.name, again.fps, again.skeleton.names) == (clip.name, clip.fps, clip.skeleton.names)
    torch.testing.assert_close(again.rotations, clip.rotations, atol=1e-6, rtol=0)
    torch.testing.assert_close(again.translation, clip.translation)
    torch.testing.assert_close(again.skeleton.heads, clip.skeleton.heads)


@pytest.mark.parametrize(
    ("name", "damage", "said"),
    [
        ("quaternions", lambda a: a * np.nan, "quaternions holds a value that is not a finite number"),
        ("quaternions", lambda a: a * 0, "rotation of the clip is not a unit quaternion"),
        ("quaternions", lambda a: a[:, :3], "quaternions has the shape"),
        ("translation", lambda a: a[:0], "translation has the shape"),
        ("joint_parents", lambda a: a[::-1], "one before its parent"),
        ("fps", lambda a: a * 0, "fps holds 0, expected 1 to 1000"),
        ("joint_heads", None, "joint_heads"),
        ("format", lambda a: np.array("uvcloth-body-1"), "motion clip"),
    ],
)
def test_damaged_clips_are_refused(tmp_path: Path, name: str, damage: Damage, said: str) -> None:
    with np.load(builtin_clips()["walk"]) as archive:
        arrays = dict(archive)
    if damage is None:
        del arrays[name]
    else:
        arrays[name] = damage(arrays[name])
    path = tmp_path / "damaged.npz"
    save_arrays(path, arrays)
    with pytest.raises(InputError, match=rf"damaged\.npz.*{said}"):
        read_clip(path)


def test_a_bvh_file_loads_by_path_and_its_faults_name_it(tmp_path: Path, body: Body) -> None:
    joints = performer()
    path = tmp_path / "mine.bvh"
    path.write_text(bvh_text(joints, still(joints)))
    assert len(load_clip(str(path), body)) == 3
    wheels = [
        (f"Wheel {index}", parent, (0.0, 1.0, 0.0), channels)
        for index, (_, parent, _, channels) in enumerate(joints)
    ]
    path.write_text(bvh_text(wheels, still(joints)))
    with pytest.raises(InputError, match=r"mine\.bvh: clip mine: .*Wheel"):
        load_clip(path, body)


def test_bones_without_length_are_refused(tmp_path: Path, body: Body) -> None:
    joints = [(name, parent, (0.0, 0.0, 0.0), channels) for name, parent, _, channels in performer()]
    path = tmp_path / "point.bvh"
    path.write_text(bvh_text(joints, still(joints)))
    with pytest.raises(
        InputError, match=r"point\.bvh: the left thigh \(LeftUpLeg to LeftLeg\) has no length"
    ):
        load_clip(path, body)


def test_a_person_beyond_what_single_precision_holds_is_refused(tmp_path: Path, body: Body) -> None:
    joints = performer()
    values = still(joints)
    values[1, 0] = 1e8
    path = tmp_path / "orbit.bvh"
    path.write_text(bvh_text(joints, values))
    with pytest.raises(
        InputError, match=r"orbit\.bvh: frame 1: the person is more than 100 km from the origin"
    ):
        load_clip(path, body)


def test_an_unknown_name_lists_the_known_ones(body: Body) -> None:
    with pytest.raises(InputError, match=r"moonwalk.*dance, jump, kick, run, spin, twirl, walk"):
        load_clip("moonwalk", body)
    with pytest.raises(InputError, match=r"absent\.bvh: no such file"):
        load_clip("absent.bvh", body)
