"""`uvcloth data`: what is there, what was refused and what is missing."""

from io import StringIO
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from tests.small_body import small_body
from uvcloth.dataset.clip import clip_of_garment
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.dataset.folder import keep_refused
from uvcloth.errors import InputError
from uvcloth.files.archive import save_arrays
from uvcloth.simulation.overview import overview


def save(path: Path, clip: str, garment: str, frames: int, **said: object) -> None:
    body = small_body()
    rest = body.mesh.vertices
    transforms = torch.eye(3, 4).repeat(frames + 2, 2, 1, 1)
    metadata = {"clip": clip, "garment": garment, "body": "box", "body_hash": "0123456789", **said}
    vertices = rest.repeat(frames + 2, 1, 1)
    save_simulated(clip_of_garment(vertices, body.mesh.faces, rest, transforms, 30.0, 2, metadata), path)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    engine = {"engine": "newton.X", "versions": {"newton": "1.8.0"}, "settings": {"density": 0.2}}
    (tmp_path / "index.csv").write_text(
        "trial,subject,split,action,window_start,window_frames\n"
        "01_01,a,train,walk,0,1000\n01_02,a,train,walk,0,500\n02_01,b,train,run,0,70\n03_01,c,test,run,0,40\n"
        "04_01,d,unused,run,0,40\n05_01,e,train,flip,0,40\n"
    )
    for garment in ("tops", "dress"):
        save(tmp_path / f"01_01_{garment}.npz", "01_01", garment, 1000, **engine)
    save(tmp_path / "03_01_tops.npz", "03_01", "tops", 40, **engine)
    save(tmp_path / "members" / "2" / "03_01_tops.npz", "03_01", "tops", 40, **engine)
    save(tmp_path / "rejected" / "03_01_dress.npz", "03_01", "dress", 40, rejected="came off", **engine)
    save(tmp_path / "02_01_tops.npz", "02_01", "tops", 70, **engine)
    keep_refused({"05_01": "LeftFoot turns by 120 degrees in frame 9"}, tmp_path)
    return tmp_path


def printed(folder: Path) -> str:
    text = StringIO()
    Console(width=160, file=text).print(overview(folder), soft_wrap=True)
    return text.getvalue()


def cells(text: str, split: str) -> list[str]:
    return next(
        line.replace("│", " ").split() for line in text.splitlines() if line.startswith(f"│ {split} ")
    )


def test_fabrics_of_outfits_are_counted_by_name(tmp_path: Path) -> None:
    """Each has numbers of its own, and would be an engine of its own."""
    for number, name in enumerate(("silk", "denim", "silk")):
        settings = {"substeps": 20, "fabric": {"density": 0.1 + 0.01 * number}}
        said = {"engine": "newton.X", "settings": settings, "fabric": name}
        save(tmp_path / f"01_01_o{number}_skirt.npz", "01_01", f"o{number}_skirt", 10, **said)
    text = printed(tmp_path)
    assert "engine: newton.X (; substeps 20), 3 sequences" in text
    assert "fabric: silk, 2 sequences" in text
    assert "fabric: denim, 1 sequences" in text


def test_it_counts_frames_people_and_clips_by_split(folder: Path) -> None:
    text = printed(folder)
    assert "4 sequences, 2,110 scored frames" in text
    files = [*folder.glob("*.npz"), *(folder / "rejected").glob("*.npz")]
    size = sum(path.stat().st_size for path in files)
    assert f"{size / 1e6:,.1f} MB" in text
    assert cells(text, "train")[:5] == ["train", "2", "2", "1,000", "1,070"]
    assert cells(text, "train")[5:] == ["4", "1,610"]
    assert cells(text, "test")[:5] == ["test", "1", "1", "0", "40"]
    assert f"{folder / 'members' / '2'}: 1 sequences, 40 scored frames" in text
    assert cells(text, "validation")[:3] == ["validation", "0", "0"]


def test_it_says_who_made_it_what_was_refused_and_what_is_missing(folder: Path) -> None:
    save_arrays(folder / "old_tops.npz", {"format": np.array("uvcloth-sequence-1")})
    text = printed(folder)
    assert "body: box (01234567), 4 sequences" in text
    assert "engine: newton.X (newton 1.8.0; density 0.2), 4 sequences" in text
    assert "refused: rejected/03_01_dress.npz, came off" in text
    assert "refused before it was simulated: 05_01, LeftFoot turns by 120 degrees in frame 9" in text
    assert "missing of train: 3 sequences of 2 clips (01_02, 02_01)" in text
    assert "missing of test" not in text
    assert "unreadable: " in text
    assert "simulate older ones again" in text


def test_outfits_are_counted_by_type_split_and_person(tmp_path: Path) -> None:
    for name, subject, frames in (("o0001_tshirt", "a", 40), ("o0002_tshirt", "b", 30)):
        said = {"types": {name: "tshirt"}, "outfit": name[:5], "split": "train", "subject": subject}
        save(tmp_path / f"walk_{name}.npz", "walk", name, frames, **said)
    assert cells(printed(tmp_path), "train") == ["train", "2", "1", "70"]


def test_a_folder_without_an_index_and_one_without_sequences(folder: Path, tmp_path: Path) -> None:
    (folder / "index.csv").unlink()
    assert cells(printed(folder), "without an index")[3:6] == ["3", "1,000", "1,110"]
    with pytest.raises(InputError, match="no such folder"):
        overview(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"empty: no sequence"):
        overview(tmp_path / "empty")
    (folder / "refused.csv").write_text("name\n1\n")
    with pytest.raises(InputError, match=r"refused\.csv: not a table with the columns clip and reason"):
        overview(folder)


def test_each_folder_of_a_plan_is_listed_with_what_it_lacks(folder: Path) -> None:
    (folder / "plan.csv").write_text(
        "clip,start,frames,garments,body,split,subject,action\n"
        "01_01,0,1000,tops,,train,a,walk\n"
        "01_02,0,500,skirt,,train,a,walk\n"
        "03_01,0,40,dress,,test,c,run\n"
        "01_01,0,1000,tops,bodies/tall.npz,train,a,walk\n"
    )
    (folder / "tall").mkdir()
    (folder / "tall" / "index.csv").write_text(
        "trial,subject,split,action,window_start,window_frames\n01_01,a,train,walk,0,1000\n"
    )
    text = printed(folder)
    assert "2 of 4 planned sequences are there or refused" in text
    assert "missing of train: 1 sequences of 1 clips (01_02)" in text
    assert "missing of test" not in text
    assert "tall: 0 sequences" in text
    assert "missing of train: 1 sequences of 1 clips (01_01)" in text
