"""Splits by person: what an index says, what it must not say, and where its clips are."""

from collections import Counter
from pathlib import Path

import pytest

from uvcloth.errors import InputError
from uvcloth.motion.index import clip_file, read_index

HEADER = "trial,subject,split,action,window_start,window_frames\n"


def table(folder: Path, rows: str, header: str = HEADER) -> Path:
    path = folder / "index.csv"
    path.write_text(header + rows)
    return path


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("walk,a,test,walking,-1,30\n", "the window of walk starts at -1"),
        ("walk,a,test,walking,0,0\n", "the window of walk starts at 0 and has 0 frames"),
        ("walk,a,test,walking,0,x\n", "the window of walk is not given in whole frames"),
        ("walk,a,test,walking,0,30\nwalk,a,test,walking,0,30\n", "two rows for the clip walk"),
        ("walk,a,extra,walking,0,30\n", "the split of walk is 'extra', expected train, validation, test or"),
        ("walk,,test,walking,0,30\n", "does not name the person of walk"),
        ("walk,a\n", "the split of walk is '', expected train"),
    ],
)
def test_an_index_says_what_is_wrong_with_it(tmp_path: Path, rows: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"index\.csv: .*{words}"):
        read_index(table(tmp_path, rows))
    with pytest.raises(InputError, match="a folder or a device"):
        read_index(tmp_path)


def test_an_index_without_persons_says_what_to_add(tmp_path: Path) -> None:
    old = table(tmp_path, "walk,test,walking,0,30\n", "trial,split,action,window_start,window_frames\n")
    with pytest.raises(InputError, match=r"lacks the column subject; add one that names the captured person"):
        read_index(old)
    with pytest.raises(InputError, match=r"lacks the column action, window_start"):
        read_index(table(tmp_path, "", "trial,subject,split,window_frames\n"))


@pytest.mark.parametrize("one", ["train", "validation", "test"])
@pytest.mark.parametrize("other", ["train", "validation", "test"])
def test_a_person_is_in_one_split_only(tmp_path: Path, one: str, other: str) -> None:
    path = table(tmp_path, f"walk,ann,{one},,0,9\nrun,bob,{one},,0,9\njump,ann,{other},,0,9\n")
    if one == other:
        assert {entry.subject for entry in read_index(path).values()} == {"ann", "bob"}
        return
    words = rf"person ann is in two splits, {one} \(clip walk\) and {other} \(clip jump\)"
    with pytest.raises(InputError, match=words):
        read_index(path)


def test_unused_clips_may_be_of_anyone_and_other_columns_do_not_matter(tmp_path: Path) -> None:
    header = "mood,file,trial,subject,split,action,window_start,window_frames\n"
    rows = "gay,cmu/walk.bvh,walk,ann,test,walking,3,9\n,,run,ann,unused,run,0,9\n"
    entries = read_index(table(tmp_path, rows, header))
    assert [(e.subject, e.split, e.file) for e in entries.values()] == [
        ("ann", "test", "cmu/walk.bvh"),
        ("ann", "unused", ""),
    ]
    assert (entries["walk"].action, entries["walk"].start, entries["walk"].frames) == ("walking", 3, 9)


def test_clips_are_found_by_what_the_index_says_or_by_name(tmp_path: Path) -> None:
    rows = "a,x,train,,0,9,deep/er/one.bvh\nb,x,train,,0,9,\nc,x,train,,0,9,\nd,x,train,,0,9,\n"
    entries = read_index(table(tmp_path, rows, HEADER.replace("frames\n", "frames,file\n")))
    for file in ("deep/er/one.bvh", "b.bvh", "sub/c.bvh", "sub/d.bvh", "other/d.bvh"):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).touch()
    found = [clip_file(entries[name], tmp_path).relative_to(tmp_path) for name in "abc"]
    assert found == [Path("deep/er/one.bvh"), Path("b.bvh"), Path("sub/c.bvh")]
    with pytest.raises(InputError, match=r"holds two clips d \(.*other/d\.bvh and .*sub/d\.bvh\)"):
        clip_file(entries["d"], tmp_path)
    (tmp_path / "deep/er/one.bvh").unlink()
    (tmp_path / "b.bvh").unlink()
    with pytest.raises(InputError, match=r"lacks the clip a \(deep/er/one\.bvh\)"):
        clip_file(entries["a"], tmp_path)
    with pytest.raises(InputError, match=r"lacks the clip b \(b\.bvh\)"):
        clip_file(entries["b"], tmp_path)


def test_the_benchmark_keeps_people_apart(mocap_folder: Path) -> None:
    entries = read_index(mocap_folder / "index_v2.csv")
    splits = Counter(entry.split for entry in entries.values())
    assert splits == {"train": 149, "validation": 8, "test": 12, "unused": 37}
    assert sum(entry.frames for entry in entries.values() if entry.split == "train") == 17373
    assert all(clip_file(entry, mocap_folder).stem == clip for clip, entry in entries.items())


def test_a_clip_of_an_index_lies_in_the_folder_of_clips(tmp_path: Path) -> None:
    """Neither a name nor a file of an index leads elsewhere."""
    (tmp_path / "clips").mkdir()
    for name in ("a.bvh", "clips/a.bvh"):
        (tmp_path / name).write_text("a clip")
    index = tmp_path / "index.csv"
    for file in ("../a.bvh", str(tmp_path / "a.bvh")):
        index.write_text(f"{HEADER.strip()},file\na,ann,train,walk,0,10,{file}\n")
        with pytest.raises(InputError, match="lies outside clips and is not read"):
            clip_file(read_index(index)["a"], tmp_path / "clips")
    for trial in ("../a", "clips/a", "*"):
        index.write_text(f"{HEADER}{trial},ann,train,walk,0,10\n")
        with pytest.raises(InputError, match=r"index\.csv: the trial .* cannot be part of a file's name"):
            read_index(index)
    index.write_text(f"{HEADER}[ab],ann,train,walk,0,10\n")
    with pytest.raises(InputError, match=r"lacks the clip \[ab\]"):
        clip_file(read_index(index)["[ab]"], tmp_path / "clips")
