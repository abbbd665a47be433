from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from tests.small_body import small_body
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.files.archive import save_arrays
from uvcloth.motion.poses import PoseDatabase, load_poses, save_poses


@pytest.fixture
def poses() -> PoseDatabase:
    """Four poses of the small body."""
    rotations = Rotation.random(8, rng=0).as_matrix().astype(np.float32)
    return PoseDatabase(
        joints=("hips", "chest"),
        rotations=torch.from_numpy(rotations).view(4, 2, 3, 3),
        clip_names=("walk", "run"),
        subjects=("ann", ""),
        clips=torch.tensor([0, 1, 0, 1]),
        frames=torch.tensor([5, 0, 2, 9]),
        mirrored=torch.tensor([False, True, False, False]),
        splits=torch.tensor([0, 0, 1, 2]),
        donors=torch.tensor([[-1] * 4, [0, 0, 0, 0], [-1] * 4, [-1] * 4]),
        apart=0.5,
        body_name="box",
        body_hash=small_body().identity.shape,
    )


def test_poses_save_and_load(tmp_path: Path, poses: PoseDatabase) -> None:
    save_poses(poses, tmp_path / "poses.npz")
    again = load_poses(tmp_path / "poses.npz", small_body())
    torch.testing.assert_close(again.rotations, poses.rotations, atol=1e-6, rtol=0)
    for name in ("clips", "frames", "mirrored", "splits", "donors"):
        torch.testing.assert_close(getattr(again, name), getattr(poses, name))
    for name in ("joints", "clip_names", "subjects", "apart", "body_name", "body_hash"):
        assert getattr(again, name) == getattr(poses, name)


def test_a_split_holds_its_poses_only(poses: PoseDatabase) -> None:
    train, test = poses.of("train"), poses.of("test")
    assert (len(train), len(poses.of("validation")), len(test)) == (2, 1, 1)
    assert train.frames.tolist() == [5, 0]
    torch.testing.assert_close(test.rotations, poses.rotations[3:])


def test_a_split_names_its_clips_and_people(poses: PoseDatabase) -> None:
    assert poses.clips_of("train") == {"walk": "ann", "run": ""}
    assert poses.clips_of("validation") == {"walk": "ann"}
    assert poses.clips_of("test") == {"run": ""}


def test_the_roots_head_stays_at_rest(poses: PoseDatabase) -> None:
    skeleton = small_body().skeleton
    transforms = poses.transforms(skeleton)
    posed = transforms[:, :, :, :3] @ skeleton.heads[:, :, None] + transforms[..., 3:]
    torch.testing.assert_close(posed[:, 0, :, 0], skeleton.heads[:1].expand(4, 3))
    turned = poses.rotations[:, 0] @ (skeleton.heads[1] - skeleton.heads[0])
    torch.testing.assert_close(posed[:, 1, :, 0], skeleton.heads[0] + turned)


def test_bodies_of_one_shape_have_one_hash() -> None:
    assert small_body().identity.shape == replace(small_body(), name="other").identity.shape
    assert small_body().identity.shape != small_body(scale=1.001).identity.shape


def test_poses_of_another_skeleton_are_refused(tmp_path: Path, poses: PoseDatabase, body: Body) -> None:
    save_poses(poses, tmp_path / "box.npz")
    with pytest.raises(InputError, match=r"box\.npz: the poses have another skeleton than the body default"):
        load_poses(tmp_path / "box.npz", body)


@pytest.mark.parametrize(
    ("name", "damage", "said"),
    [
        ("quaternions", lambda a: a * np.nan, "not a finite number"),
        ("quaternions", lambda a: a * 0, "not a unit quaternion"),
        ("quaternions", lambda a: a[:, :1], "quaternions has the shape"),
        ("quaternions", lambda a: a[:0], "clips has the shape"),
        ("quaternions", lambda a: a[0, 0, 0], "quaternions has the shape"),
        ("frames", lambda a: a[1:], "frames has the shape"),
        ("frames", lambda a: a - 1, "frames holds -1, expected 0 to"),
        ("clips", lambda a: a + 1, "clips holds 2, expected 0 to 1"),
        ("splits", lambda a: a + 1, "splits holds 3, expected 0 to 2"),
        ("splits", lambda a: a.astype(str), "splits holds str"),
        ("donors", lambda a: a[:, :3], "donors has the shape"),
        ("donors", lambda a: a + 4, "donors holds 4"),
        ("mirrored", lambda a: a.astype(float), "expected truth values"),
        ("apart", lambda a: np.array([0.5]), "apart has the shape"),
        ("body_hash", None, "lacks the array body_hash"),
        ("format", lambda a: np.array("uvcloth-clip-1"), "poses drawn by"),
    ],
)
def test_damaged_poses_are_refused(
    tmp_path: Path,
    poses: PoseDatabase,
    name: str,
    damage: Callable[[np.ndarray], np.ndarray] | None,
    said: str,
) -> None:
    save_poses(poses, tmp_path / "whole.npz")
    with np.load(tmp_path / "whole.npz") as archive:
        arrays = dict(archive)
    if damage is None:
        del arrays[name]
    else:
        arrays[name] = damage(arrays[name])
    save_arrays(tmp_path / "damaged.npz", arrays)
    with pytest.raises(InputError, match=rf"damaged\.npz.*{said}"):
        load_poses(tmp_path / "damaged.npz", small_body())
