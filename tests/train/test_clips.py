"""What is trained on, what chooses, and what is never looked at."""

from pathlib import Path

import pytest

from rasterize.errors import InputError
from tests.train.simulated import save_clips
from train.clips import Holdout, hold_out, load_training_clips, training_data
from uvcloth.bodies.body import Body

HEADER = "trial,subject,split,action,window_start,window_frames\n"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sequences")
    save_clips(folder, ("tops",), clips=7, frames=5)
    save_clips(folder, ("tops", "bottoms"), clips=2, frames=5)
    return folder


def shares(data: Path, body: Body, index: str = "", holdout: int = 8) -> tuple[list[str], list[str]]:
    """The clips of training and validation, by the rows of an index if there are any."""
    (data / "index.csv").unlink(missing_ok=True)
    if index:
        (data / "index.csv").write_text(HEADER + index)
    clips = load_training_clips(data, ("tops",), body)
    training, held = hold_out(clips, Holdout(holdout), data)
    return [r.clip for r in training], [r.clip for r in held]


def test_an_index_says_what_trains_and_what_chooses(data: Path, body: Body) -> None:
    index = (
        "clip0,ann,train,,0,5\nclip1,bob,validation,,0,5\nclip2,cid,test,,0,5\n"
        "clip3,cid,unused,,0,5\nclip4,ann,train,,0,5\n"
    )
    assert shares(data, body, index) == (["clip0", "clip4"], ["clip1"])
    training, held = hold_out(load_training_clips(data, ("tops", "bottoms"), body), Holdout(), data)
    made_from = training_data(training, held)
    assert made_from.clips == {"train": {"clip0": "ann", "clip4": "ann"}, "validation": {"clip1": "bob"}}
    assert made_from.files.keys() == {
        "clip0_tops.npz",
        "clip0_bottoms.npz",
        "clip1_tops.npz",
        "clip4_tops.npz",
    }
    assert all(len(digest) == 64 for digest in made_from.files.values())


@pytest.mark.parametrize(("one", "lacking"), [("train", "validation"), ("validation", "train")])
def test_an_index_has_to_leave_both(data: Path, body: Body, one: str, lacking: str) -> None:
    with pytest.raises(InputError, match=f"no sequence for {lacking}; simulate clips that index.csv calls"):
        shares(data, body, f"clip0,ann,{one},,0,5\nclip1,bob,test,,0,5\nnone,cid,{lacking},,0,5\n")
    with pytest.raises(InputError, match="none of its sequences is a training clip of tops"):
        shares(data, body, "clip1,bob,test,,0,5\n")


def test_without_an_index_every_nth_clip_chooses(data: Path, body: Body) -> None:
    assert shares(data, body, holdout=2) == (["clip0", "clip2", "clip4"], ["clip1", "clip3", "clip5"])
    assert shares(data, body, holdout=3)[1] == ["clip2", "clip5"]
    assert shares(data, body, holdout=9)[1] == ["clip5"]
    clips = load_training_clips(data, ("tops",), body)
    assert [[r.clip for r in part] for part in hold_out(clips[:1], Holdout(), data)] == [["clip0"], []]
    assert training_data(clips[:1], []).clips == {"train": {"clip0": ""}, "validation": {}}
    with pytest.raises(InputError, match="--holdout 1: has to be 2 or more"):
        Holdout(1)


def test_the_warm_up_teaches_but_for_its_beginning_and_validates_never(data: Path, body: Body) -> None:
    clips = load_training_clips(data, ("tops", "bottoms"), body)
    for rest_frames, left_out in ((0, 0), (1, 1), (15, 3)):
        training, held = hold_out(clips, Holdout(rest_frames=rest_frames), data)
        assert {r.warm_up for r in training} == {left_out}
        assert {r.warm_up for r in held} == {3}
