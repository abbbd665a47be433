from pathlib import Path

import pytest

from uvcloth.errors import InputError
from uvcloth.motion.clip_splits import find_sources
from uvcloth.motion.library import builtin_clips

HEADER = "trial,subject,split,action,window_start,window_frames\n"


def folder_of(path: Path, names: list[str], index: str = "") -> str:
    (path / "cmu").mkdir(parents=True)
    for name in names:
        (path / "cmu" / f"{name}.bvh").touch()
    if index:
        (path / "index.csv").write_text(HEADER + index)
    return str(path)


def splits(clips: list[str]) -> list[str]:
    return [source.split for source in find_sources(clips)]


@pytest.mark.parametrize(
    ("count", "held_out"), [(1, (0, 0)), (2, (1, 0)), (3, (1, 1)), (6, (1, 1)), (20, (3, 3)), (100, (15, 15))]
)
def test_whole_clips_are_held_out(tmp_path: Path, count: int, held_out: tuple[int, int]) -> None:
    found = splits([folder_of(tmp_path, [f"{number:03}" for number in range(count)])])
    assert (found.count("validation"), found.count("test")) == held_out
    assert found.count("train") == count - sum(held_out)


def test_no_clips_are_the_builtin_ones() -> None:
    sources = find_sources(())
    assert [source.name for source in sources] == list(builtin_clips())
    assert [source.split for source in sources] == [
        "train",
        "train",
        "train",
        "validation",
        "test",
        "train",
        "train",
    ]


INDEX = "a1,ann,train,,0,9\na2,ann,train,,0,9\nb,bob,validation,,0,9\nc,cid,test,,0,9\nd,cid,unused,,0,9\n"


def test_an_index_decides_and_what_is_unused_is_left_out(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, ["a1", "a2", "b", "c", "d", "unnamed"], INDEX)
    found = [(source.name, source.split, source.subject) for source in find_sources([folder])]
    assert found == [
        ("a1", "train", "ann"),
        ("a2", "train", "ann"),
        ("b", "validation", "bob"),
        ("c", "test", "cid"),
    ]


def test_an_index_by_another_name_decides_over_a_folder_of_clips(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "clips", ["a1", "a2", "b", "c"], "a1,ann,test,,0,9\n")
    named = tmp_path / "mine.csv"
    named.write_text(HEADER + INDEX)
    sources = find_sources((), named, Path(folder))
    assert [source.split for source in sources] == ["train", "train", "validation", "test"]
    assert sources[0].file == str(tmp_path / "clips" / "cmu" / "a1.bvh")
    assert [source.name for source in find_sources(["walk"], named, Path(folder))][-1] == "walk"
    for half in ({"windows": named}, {"clips_from": Path(folder)}):
        with pytest.raises(InputError, match="--windows and --clips-from go together"):
            find_sources((), **half)


def test_no_person_of_the_benchmark_poses_for_two_splits(mocap_folder: Path) -> None:
    sources = find_sources((), mocap_folder / "index_v2.csv", mocap_folder)
    people = [{s.subject for s in sources if s.split == split} for split in ("train", "validation", "test")]
    assert [len(each) for each in people] == [20, 5, 7]
    assert len(set[str]().union(*people)) == 32


def test_files_and_names_go_together(tmp_path: Path) -> None:
    folder_of(tmp_path, ["a", "b"])
    sources = find_sources([str(tmp_path / "cmu" / "a.bvh"), "walk"])
    assert [(source.name, source.split) for source in sources] == [("a", "train"), ("walk", "validation")]


def test_folders_of_amass_hold_motions_and_shapes(tmp_path: Path) -> None:
    for name in ("01/01_01_poses.npz", "01/shape.npz", "02/walk_stageii.npz", "02/neutral_stagei.npz"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert [source.name for source in find_sources([str(tmp_path)])] == ["01_01_poses", "walk_stageii"]


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no motion files \(\*\.bvh, "):
        find_sources([str(tmp_path)])
    absent = folder_of(tmp_path / "absent", ["a"], "b,bob,train,walk,0,9\n")
    with pytest.raises(InputError, match=r"absent: lacks the clip b \(b\.bvh\)"):
        find_sources([absent])
    idle = folder_of(tmp_path / "idle", ["a"], "a,ann,unused,walk,0,9\n")
    with pytest.raises(InputError, match=r"idle/index\.csv: assigns no clip to train, validation, test"):
        find_sources([idle])
    other = folder_of(tmp_path / "other", ["a"])
    for clips in ([other, str(Path(other) / "cmu" / "a.bvh")], [other, folder_of(tmp_path / "third", ["a"])]):
        with pytest.raises(InputError, match=r"a\.bvh: another clip is also named a"):
            find_sources(clips)
