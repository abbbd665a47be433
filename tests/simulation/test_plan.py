"""Which simulations a batch is, and in which order."""

from collections import Counter
from pathlib import Path

import pytest

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.joined import EngineMesh, join
from uvcloth.garments.templates import fit_template
from uvcloth.motion.index import Entry, read_index
from uvcloth.motion.library import builtin_clips
from uvcloth.simulation.plan import ClipSelection, Job, batch_sources, interleaved, plan

HEADER = "trial,subject,split,action,window_start,window_frames\n"


@pytest.fixture(scope="module")
def dress(body: Body) -> tuple[EngineMesh, ...]:
    return (join(fit_template("dress", body), body),)


@pytest.fixture
def table(tmp_path: Path) -> Path:
    (tmp_path / "index.csv").write_text(HEADER + "walk,a,test,walking,40,30\nrun,b,test,run,90,50\n")
    return tmp_path / "index.csv"


def jobs(clips: list[str], dress: tuple[EngineMesh, ...], body: Body, table: Path) -> list[Job]:
    sources = batch_sources(ClipSelection(clips, table))
    return plan(sources, [dress], [table.parent], body)[0]


def test_windows_choose_frames_and_name_what_is_wrong(
    dress: tuple[EngineMesh, ...], body: Body, table: Path
) -> None:
    (job,) = jobs(["walk"], dress, body, table)
    assert (len(job.motion), job.warm_up, job.targets[0].name) == (45, 15, "walk_dress.npz")
    with pytest.raises(InputError, match="the window ends at 140"):
        jobs(["run"], dress, body, table)
    with pytest.raises(InputError, match="no row for the clip twirl"):
        jobs(["twirl"], dress, body, table)
    table.write_text("name\nwalk\n")
    with pytest.raises(InputError, match=r"index\.csv: lacks the column subject"):
        jobs(["walk"], dress, body, table)


def test_two_clips_for_one_file_are_refused(
    dress: tuple[EngineMesh, ...], body: Body, tmp_path: Path
) -> None:
    shipped = builtin_clips()["walk"]
    sources = batch_sources(ClipSelection(["walk", str(shipped)]))
    with pytest.raises(InputError, match=rf"walk_dress\.npz: both walk and {shipped}"):
        plan(sources, [dress], [tmp_path], body)


def test_what_is_there_is_not_read_again(dress: tuple[EngineMesh, ...], body: Body, tmp_path: Path) -> None:
    (tmp_path / "rejected").mkdir()
    (tmp_path / "rejected" / "gone_dress.npz").touch()
    (tmp_path / "walk_dress.npz").touch()
    sources = batch_sources(ClipSelection(["gone.bvh", "walk"]))
    assert plan(sources, [dress], [tmp_path], body) == ([], {})
    todo, _ = plan(sources[1:], [dress], [tmp_path, tmp_path / "members" / "1"], body)
    assert [(job.member, job.targets) for job in todo] == [(1, (tmp_path / "members/1/walk_dress.npz",))]


def test_a_whole_index_gives_the_clips_of_its_splits(tmp_path: Path) -> None:
    windows, clips = tmp_path / "v2.csv", tmp_path / "clips"
    (clips / "cmu").mkdir(parents=True)
    rows = [("a1", "a", "train"), ("b1", "b", "test"), ("c1", "c", "validation"), ("d1", "d", "unused")]
    windows.write_text(HEADER + "".join(f"{clip},{who},{split},walk,0,9\n" for clip, who, split in rows))
    for clip in ("a1", "b1", "c1"):
        (clips / "cmu" / f"{clip}.bvh").touch()
    found = batch_sources(ClipSelection((), windows, clips))
    assert [source.clip for source in found] == ["c1", "b1", "a1"]
    assert found[0].name == str(clips / "cmu" / "c1.bvh")
    assert [source.clip for source in batch_sources(ClipSelection((), windows, clips, ["test"]))] == ["b1"]
    (clips / "cmu" / "b1.bvh").unlink()
    with pytest.raises(InputError, match=r"clips: lacks the clip b1"):
        batch_sources(ClipSelection((), windows, clips))
    for wrong, words in (
        (((), windows, clips, ["unused"]), "--split unused: expected some of train, validation, test"),
        ((["a1"], windows, clips, None), "--clips-from and --split choose the clips"),
        ((["a1"], None, clips, None), "go with --windows"),
    ):
        with pytest.raises(InputError, match=words):
            batch_sources(ClipSelection(*wrong))


def test_any_beginning_has_its_share_of_every_person_and_action() -> None:
    entries = [
        Entry(f"{person}{n}", person, "train", "walk" if n % 3 else "dance", 0, 9)
        for person, count in (("a", 30), ("b", 15), ("c", 6))
        for n in range(count)
    ]
    order = interleaved(entries)
    assert sorted(order, key=str) == sorted(entries, key=str)
    assert order == interleaved(reversed(entries))
    for length in (10, 17, 34, 51):
        people = Counter(entry.subject for entry in order[:length])
        actions = Counter(entry.action for entry in order[:length])
        for person, count in (("a", 30), ("b", 15), ("c", 6)):
            assert abs(people[person] - count * length / 51) <= 1.5
        assert abs(actions["dance"] - length / 3) <= 2.0


def test_the_benchmark_starts_with_validation_and_test(mocap_folder: Path) -> None:
    order = interleaved(e for e in read_index(mocap_folder / "index_v2.csv").values() if e.split != "unused")
    splits = [entry.split for entry in order]
    assert splits == sorted(splits, key=["validation", "test", "train"].index)
    beginning = order[splits.index("train") :][:30]
    assert len({entry.subject for entry in beginning}) >= 10
    assert sum("walk" in entry.action.lower() for entry in beginning) <= 15


def test_a_file_that_windows_cannot_have_is_refused(
    dress: tuple[EngineMesh, ...], body: Body, tmp_path: Path
) -> None:
    sources = batch_sources(ClipSelection(["mocap/12:30.bvh"]))
    with pytest.raises(InputError, match=r"12:30\.bvh: '12:30_dress\.npz' cannot be the name of a file"):
        plan(sources, [dress], [tmp_path], body)
