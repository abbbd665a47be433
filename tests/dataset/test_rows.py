"""Rows of clips: what leads in to them, windows, the rows before, and motion without cloth."""

from pathlib import Path

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.dataset.clip import SimulatedClip, SimulatedGarment
from uvcloth.dataset.reader import read_motions
from uvcloth.dataset.rows import Rows, joined_rows, joined_vertices
from uvcloth.errors import InputError
from uvcloth.motion.library import builtin_clips, load_clip


def clip(name: str, frames: int, warm_up: int, fps: float) -> SimulatedClip:
    """A body, and a garment of one vertex, which are at X = frame."""
    transforms = torch.eye(3, 4).repeat(frames, 1, 1, 1)
    transforms[:, 0, 0, 3] = torch.arange(frames)
    garment = SimulatedGarment("tops", transforms[:, :, :, 3], torch.zeros(0, 3), torch.zeros(1, 3))
    return SimulatedClip((garment,), transforms, fps, warm_up, {"clip": name})


CLIPS = [clip("a", 7, 4, 30.0), clip("b", 5, 0, 60.0)]
"""Of the first, frames 4 to 6 are scored, of the second all."""


@pytest.fixture
def rows() -> Rows:
    return joined_rows(CLIPS, 2)


def test_each_clip_is_led_in_by_its_warm_up(rows: Rows) -> None:
    assert rows.transforms[:, 0, 0, 3].tolist() == [2, 3, 4, 5, 6, 0, 1, 2, 3, 4]
    assert torch.equal(joined_vertices(CLIPS, "tops", 2)[:, 0, 0], rows.transforms[:, 0, 0, 3])
    assert rows.fps.tolist() == [30.0] * 5 + [60.0] * 5
    assert rows.starts.tolist() == [0] * 5 + [5] * 5
    # Where there is no warm-up, the first scored frames are those before.
    assert rows.samples.tolist() == [2, 3, 4, 7, 8, 9]


def test_single_frames_are_all_that_are_scored() -> None:
    assert joined_rows(CLIPS, 0).samples.tolist() == list(range(8))


def test_windows_end_in_their_clip(rows: Rows) -> None:
    assert rows.windows(1).tolist() == rows.samples.tolist()
    assert rows.windows(3).tolist() == [2, 7]
    assert rows.windows(4).tolist() == []


def test_the_rows_before_are_oldest_first_and_of_the_same_clip(rows: Rows) -> None:
    before, known = rows.before(torch.tensor([4, 6]), 3)
    assert before.tolist() == [[1, 2, 3], [3, 4, 5]]
    assert known.tolist() == [[True, True, True], [False, False, True]]


def test_motion_without_cloth_has_rows_too(body: Body, tmp_path: Path) -> None:
    index = tmp_path / "index.csv"
    head = "trial,subject,split,action,window_start,window_frames,file\n"
    walk, run = (Path(builtin_clips()[name]) for name in ("walk", "run"))
    rows = f"walk,ann,train,walking,5,4,{walk.name}\nrun,bob,test,running,0,3,{run.name}\n"
    index.write_text(head + rows)
    (moving,) = read_motions(index, body, ("train",), walk.parent)
    assert (moving.name, moving.subject, moving.action, moving.garments) == ("walk", "ann", "walking", ())
    assert torch.equal(moving.transforms, load_clip("walk", body).transforms()[5:9])
    assert joined_rows([moving], 2).samples.tolist() == [2, 3]
    index.write_text(head + rows.replace("5,4", "5,4000"))
    with pytest.raises(InputError, match=r"walk\.npz: has .* frames, the window ends at 4005"):
        read_motions(index, body, ("train",), walk.parent)
