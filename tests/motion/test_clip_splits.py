from pathlib import Path

import pytest

from rasterize.errors import InputError
from uvcloth.motion.clip_splits import find_sources
from uvcloth.motion.library import builtin_clips


def folder_of(path: Path, names: list[str], index: str = "") -> str:
    (path / "cmu").mkdir(parents=True)
    for name in names:
        (path / "cmu" / f"{name}.bvh").touch()
    if index:
        (path / "index.csv").write_text("trial,split,action,window_start,window_frames\n" + index)
    return str(path)


def splits(clips: list[str], extra: bool = False) -> list[str]:
    return [source.split for source in find_sources(clips, extra)]


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
    assert [source.split for source in sources] == ["train", "train", "train", "validation", "test", "train"]


def test_an_index_decides_and_extra_clips_are_for_training_alone(tmp_path: Path) -> None:
    index = "".join(f"t{number},train,walk,0,9\n" for number in range(7))
    folder = folder_of(
        tmp_path, [*(f"t{n}" for n in range(7)), "u", "x"], index + "u,test,run,0,9\ne,extra,,0,9\n"
    )
    plain, more = ({s.name: s.split for s in find_sources([folder], extra)} for extra in (False, True))
    assert plain == {f"t{n}": "train" for n in range(7)} | {"t3": "validation", "u": "test"}
    assert more == plain | {"x": "train"}


def test_files_and_names_go_together(tmp_path: Path) -> None:
    folder_of(tmp_path, ["a", "b"])
    sources = find_sources([str(tmp_path / "cmu" / "a.bvh"), "walk"])
    assert [(source.name, source.split) for source in sources] == [("a", "train"), ("walk", "validation")]


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no BVH files"):
        find_sources([str(tmp_path)])
    indexed = folder_of(tmp_path / "indexed", ["a"], "b,train,walk,0,9\n")
    with pytest.raises(InputError, match=r"index\.csv: names no train or test clip"):
        find_sources([indexed])
    assert splits([indexed], extra=True) == ["train"]
    other = folder_of(tmp_path / "other", ["a"])
    for clips in ([other, str(Path(other) / "cmu" / "a.bvh")], [other, folder_of(tmp_path / "third", ["a"])]):
        with pytest.raises(InputError, match=r"a\.bvh: another clip is also named a"):
            find_sources(clips)
