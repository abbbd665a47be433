"""The poses to train on: from a file as it is, or drawn from motion into the run, once."""

from dataclasses import replace
from pathlib import Path

import pytest
from torch import Tensor

from tests.train.simulated import database_of
from train.pbns import poses
from train.pbns.poses import POSES_FILE, poses_for
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.skinning import skin
from uvcloth.motion.poses import save_poses


def test_poses_that_lack_a_split_are_refused(body: Body, tmp_path: Path) -> None:
    for held in (0, 9):
        save_poses(database_of(body, held=held), tmp_path / "poses.npz")
        with pytest.raises(InputError, match=r"/poses\.npz: lacks training or validation poses"):
            poses_for([str(tmp_path / "poses.npz")], body, tmp_path / "run")
    with pytest.raises(InputError, match="--poses walk: lacks training or validation poses, name more clips"):
        poses_for(["walk"], body, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_file_of_poses_is_taken_as_it_is(body: Body, tmp_path: Path) -> None:
    save_poses(database_of(body), tmp_path / "mine.npz")
    taken = poses_for([str(tmp_path / "mine.npz")], body, tmp_path / "run")
    assert len(taken.database) == 9
    assert list(taken.data.files) == ["mine.npz"]
    assert len(taken.data.files["mine.npz"]) == 64
    assert taken.data.clips == {"train": {"swaying": "ann"}, "validation": {"swaying": "ann"}}
    assert not (tmp_path / "run").exists()
    save_poses(database_of(body, frames=8), tmp_path / "mine.npz")
    assert poses_for([str(tmp_path / "mine.npz")], body, tmp_path / "run").data.files != taken.data.files


def test_poses_of_another_skeleton_are_refused(body: Body, tmp_path: Path) -> None:
    renamed = replace(database_of(body), joints=("root", *body.skeleton.names[1:]))
    save_poses(renamed, tmp_path / "mine.npz")
    with pytest.raises(InputError, match=r"mine\.npz: the poses have another skeleton than the body"):
        poses_for([str(tmp_path / "mine.npz")], body, tmp_path / "run")


def test_poses_of_another_shape_are_looked_through(
    body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All but three frames are valid on this body, as the stand-in for its self-contact has it."""
    other = replace(database_of(body), body_hash="another")
    save_poses(other, tmp_path / "mine.npz")
    expected = skin(body.mesh.vertices, body.weights, other.transforms(body.skeleton))

    class AllButThree:
        def __init__(self, body: Body) -> None:
            pass

        def clear(self, vertices: Tensor) -> bool:
            return int((vertices - expected).norm(dim=2).amax(1).argmin()) not in (3, 4, 5)

    monkeypatch.setattr(poses, "SelfContact", AllButThree)
    taken = poses_for([str(tmp_path / "mine.npz")], body, tmp_path / "run")
    assert taken.database.frames.tolist() == [0, 1, 2, 6, 7, 8]
    save_poses(database_of(body), tmp_path / "own.npz")
    assert len(poses_for([str(tmp_path / "own.npz")], body, tmp_path / "run").database) == 9


def test_clips_are_drawn_into_the_run_once(
    body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(poses, "RECOMBINED", 3)
    run = tmp_path / "run"
    taken = poses_for(["jump", "twirl"], body, run)
    assert list(taken.data.files) == [POSES_FILE]
    assert taken.data.clips == {"train": {"jump": ""}, "validation": {"twirl": ""}}
    assert set(taken.database.clip_names) == {"jump", "twirl"}
    assert len(taken.database.of("train")) > 3
    assert len(taken.database.of("validation")) > 0
    drawn = (run / POSES_FILE).read_bytes()
    monkeypatch.setattr(poses, "draw_poses", None)
    again = poses_for(["jump", "twirl"], body, run)
    assert again.data == taken.data
    assert (run / POSES_FILE).read_bytes() == drawn
    with pytest.raises(InputError, match=r"run/poses\.npz: was drawn from other clips"):
        poses_for(["jump", "walk"], body, run)
    save_poses(replace(taken.database, splits=1 - taken.database.splits), run / POSES_FILE)
    with pytest.raises(InputError, match="was drawn from other clips or splits"):
        poses_for(["jump", "twirl"], body, run)
