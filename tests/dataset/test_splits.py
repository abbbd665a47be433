"""What is trained on, what chooses, and what is never looked at."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.small_body import small_body
from tests.train.physxnet.two_triangles import save_clip
from tests.train.simulated import save_clips
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.reader import read_clips
from uvcloth.dataset.splits import Holdout, hold_out, of_split, training_data
from uvcloth.errors import InputError

HEADER = "trial,subject,split,action,window_start,window_frames\n"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sequences")
    save_clips(folder, ("tops",), clips=7, frames=5)
    save_clips(folder, ("tops", "bottoms"), clips=2, frames=5)
    return folder


def clips_of(data: Path, *garments: str) -> list[SimulatedClip]:
    ((_, clips),) = read_clips([data], garments)
    return clips


def names(clips: list[SimulatedClip]) -> tuple[list[str], list[str]]:
    """The clips of training and validation."""
    training, held = of_split(clips, "train"), of_split(clips, "validation")
    return [clip.name for clip in training], [clip.name for clip in held]


def shares(data: Path, index: str = "", holdout: int = 8) -> tuple[list[str], list[str]]:
    """The clips of training and validation, by the rows of an index if there are any."""
    (data / "index.csv").unlink(missing_ok=True)
    if index:
        (data / "index.csv").write_text(HEADER + index)
    return names(hold_out(clips_of(data, "tops"), Holdout(holdout), "data"))


def test_an_index_says_what_trains_and_what_chooses(data: Path) -> None:
    index = (
        "clip0,ann,train,,0,5\nclip1,bob,validation,,0,5\nclip2,cid,test,,0,5\n"
        "clip3,cid,unused,,0,5\nclip4,ann,train,,0,5\n"
    )
    assert shares(data, index) == (["clip0", "clip4"], ["clip1"])
    made_from = training_data(hold_out(clips_of(data, "tops", "bottoms"), Holdout(), "data"))
    assert made_from.clips == {"train": {"clip0": "ann", "clip4": "ann"}, "validation": {"clip1": "bob"}}
    assert made_from.files.keys() == {
        f"{data.name}/clip0_tops.npz",
        f"{data.name}/clip0_bottoms.npz",
        f"{data.name}/clip1_tops.npz",
        f"{data.name}/clip4_tops.npz",
    }
    assert all(len(digest) == 64 for digest in made_from.files.values())


def test_several_folders_are_read_together(data: Path, tmp_path: Path) -> None:
    stout = replace(small_body(scale=1.1), name="stout")
    save_clip(tmp_path / "box", "a", {"tops": torch.zeros(4, 3)})
    save_clip(tmp_path / "stout", "a", {"tops": torch.zeros(4, 3)}, body=stout)
    folders = [tmp_path / "box", tmp_path / "stout", tmp_path / "box"]
    worn = read_clips(folders, ("tops",))
    assert [(body.name, len(clips)) for body, clips in worn] == [("box", 2), ("stout", 1)]
    (tmp_path / "box" / "index.csv").write_text(HEADER + "a,ann,train,,0,5\n")
    (tmp_path / "stout" / "index.csv").write_text(HEADER + "a,ann,validation,,0,5\n")
    with pytest.raises(
        InputError, match=r"box .*stout .*: person ann is in two splits, train \(clip a\) and validation"
    ):
        read_clips(folders, ("tops",))
    save_clip(tmp_path / "other", "a", {"tops": torch.zeros(4, 3)}, body=replace(stout, name="box"))
    with pytest.raises(InputError, match="--data: names no folder"):
        read_clips([], ("tops",))
    with pytest.raises(InputError, match="two bodies are called box"):
        read_clips([tmp_path / "box", tmp_path / "other"], ("tops",))


@pytest.mark.parametrize(("one", "lacking"), [("train", "validation"), ("validation", "train")])
def test_an_index_has_to_leave_both(data: Path, one: str, lacking: str) -> None:
    with pytest.raises(
        InputError, match=f"no sequence for {lacking}; simulate clips of this split in index.csv"
    ):
        shares(data, f"clip0,ann,{one},,0,5\nclip1,bob,test,,0,5\nnone,cid,{lacking},,0,5\n")
    with pytest.raises(InputError, match="none of its sequences is a training clip of tops"):
        shares(data, "clip1,bob,test,,0,5\n")


def test_without_an_index_every_nth_clip_chooses(data: Path) -> None:
    assert shares(data, holdout=2) == (["clip0", "clip2", "clip4"], ["clip1", "clip3", "clip5"])
    assert shares(data, holdout=3)[1] == ["clip2", "clip5"]
    assert shares(data, holdout=9)[1] == ["clip5"]
    alone = hold_out(clips_of(data, "tops")[:1], Holdout(), "data")
    assert names(alone) == (["clip0"], [])
    assert training_data(alone).clips == {"train": {"clip0": ""}, "validation": {}}
    with pytest.raises(InputError, match="--holdout 1: has to be 2 or more"):
        Holdout(1)


def test_the_warm_up_teaches_but_for_its_beginning_and_validates_never(data: Path) -> None:
    clips = clips_of(data, "tops", "bottoms")
    for rest_frames, left_out in ((0, 0), (1, 1), (15, 3)):
        dealt = hold_out(clips, Holdout(rest_frames=rest_frames), "data")
        assert {clip.warm_up for clip in of_split(dealt, "train")} == {left_out}
        assert {clip.warm_up for clip in of_split(dealt, "validation")} == {3}
