"""Plans: what their rows mean, what is wrong with them, and what is simulated of them in which order."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from uvcloth.bodies.body import Body, save_body
from uvcloth.dataset.clip import clip_of_garment
from uvcloth.dataset.clip_file import load_simulated, read_metadata, save_simulated
from uvcloth.dataset.folder import refused_captures
from uvcloth.errors import InputError
from uvcloth.geometry.skinning import skin
from uvcloth.motion.index import read_index
from uvcloth.simulation import batch
from uvcloth.simulation import plan as planning
from uvcloth.simulation.blender import Blender
from uvcloth.simulation.engines import ENGINES
from uvcloth.simulation.options import SimulationOptions
from uvcloth.simulation.plan import Job
from uvcloth.simulation.plan_file import PLAN, read_plan
from uvcloth.simulation.planned import simulate_plan

HEADER = "name,clip,start,frames,hold,garments,body,member,split,subject,action\n"
WALK = ",walk,40,30,,tops,,,train,ann,walking\n"
ROWS = (
    WALK,
    ",walk,40,30,,dress,,,train,ann,walking\n",
    ",jump,0,54,,bottoms+tops,,,validation,cid,jumping\n",
    ",jump,0,54,,tops,,,validation,cid,jumping\n",
    ",run,20,40,,tops,,,test,bob,running\n",
    ",run,20,40,,tops,bodies/broad.npz,,test,bob,running\n",
    "run_stop,run,0,40,0.5,tops,,0,test,bob,running\n",
)


@pytest.fixture
def plan(body: Body, tmp_path: Path) -> Path:
    """A plan of seven rows, and the body beside it that one of them is on."""
    wider = replace(body.mesh, vertices=body.mesh.vertices * torch.tensor([1.02, 1.0, 1.0]))
    save_body(replace(body, name="broad", mesh=wider), tmp_path / "bodies" / "broad.npz")
    (tmp_path / "plan.csv").write_text(HEADER + "".join(ROWS))
    return tmp_path / "plan.csv"


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Job]:
    """The jobs of all plans that are simulated, whose garments are simply skinned instead."""
    jobs: list[Job] = []

    def skinned(todo: Iterable[Job], *_: Any) -> None:
        for job in todo:
            jobs.append(job)
            _store_skinned(job)

    monkeypatch.setattr(batch, "simulate_all", skinned)
    return jobs


def _store_skinned(job: Job) -> None:
    transforms = job.motion.window(0, 3).transforms()
    for cloth, target in zip(job.cloths, job.targets, strict=True):
        garment = cloth.garment
        metadata = {"clip": job.motion.name, "garment": garment.name, "body": job.body.name, **job.labels}
        metadata |= {"body_hash": job.body.identity.shape, "layers": [c.garment.name for c in job.cloths]}
        vertices = skin(garment.mesh.vertices, garment.smooth_weights, transforms)
        mesh = garment.mesh
        save_simulated(
            clip_of_garment(vertices, mesh.faces, mesh.vertices, transforms, 30.0, 1, metadata), target
        )


def _files(jobs: Iterable[Job], out: Path) -> list[str]:
    return [target.relative_to(out).as_posix() for job in jobs for target in job.targets]


def test_rows_are_simulated_validation_and_test_first_and_layers_last(
    plan: Path, made: list[Job], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    simulate_plan(plan, out)
    assert _files(made, out) == [
        "jump_tops.npz",
        "run_tops.npz",
        "broad/run_tops.npz",
        "run_stop_tops.npz",
        "walk_tops.npz",
        "walk_dress.npz",
        "layered/jump_bottoms.npz",
        "layered/jump_tops.npz",
    ]
    assert [len(job.motion) - job.warm_up for job in made] == [54, 40, 40, 55, 30, 30, 54]
    assert [job.warm_up for job in made] == [0, 15, 15, 0, 15, 15, 0]
    assert [job.body.name for job in made] == ["default", "default", "broad", *["default"] * 4]


def test_each_folder_is_one_that_training_and_evaluation_read(
    plan: Path, made: list[Job], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    simulate_plan(plan, out)
    assert made
    index = read_index(out / "index.csv")
    assert {entry.clip: (entry.split, entry.subject, entry.frames) for entry in index.values()} == {
        "jump": ("validation", "cid", 54),
        "run": ("test", "bob", 40),
        "run_stop": ("test", "bob", 55),
        "walk": ("train", "ann", 30),
    }
    assert list(read_index(out / "broad" / "index.csv")) == ["run"]
    assert list(read_index(out / "layered" / "index.csv")) == ["jump"]
    assert (out / "broad" / "bodies" / "broad.npz").is_file()
    assert (out / PLAN).read_text() == plan.read_text()
    said = read_metadata(out / "run_stop_tops.npz")
    expected = {"trial": "run", "start": 0, "hold": 0.5, "member": 0, "split": "test", "subject": "bob"}
    assert {key: said[key] for key in expected} == expected
    assert said["clip"] == "run_stop"


def test_what_is_there_is_not_made_again(plan: Path, made: list[Job], tmp_path: Path) -> None:
    out = tmp_path / "out"
    simulate_plan(plan, out)
    (out / "walk_dress.npz").unlink()
    (out / "layered" / "jump_tops.npz").unlink()
    (out / "rejected").mkdir()
    (out / "run_tops.npz").rename(out / "rejected" / "run_tops.npz")
    del made[:]
    simulate_plan(plan, out)
    assert _files(made, out) == ["walk_dress.npz", "layered/jump_bottoms.npz", "layered/jump_tops.npz"]


def test_a_plan_may_grow_but_not_change_a_window(plan: Path, made: list[Job], tmp_path: Path) -> None:
    out = tmp_path / "out"
    simulate_plan(plan, out)
    del made[:]
    plan.write_text(HEADER + "".join(ROWS) + ",spin,0,30,,tops,,,train,eve,spinning\n")
    simulate_plan(plan, out)
    assert _files(made, out) == ["spin_tops.npz"]
    assert list(read_index(out / "index.csv"))[-1] == "spin"
    plan.write_text(HEADER + WALK.replace("40,30", "41,30"))
    with pytest.raises(InputError, match=r"out/index\.csv: holds another window of walk, simulate this one"):
        simulate_plan(plan, out)


def test_data_of_another_engine_or_body_are_refused(plan: Path, made: list[Job], tmp_path: Path) -> None:
    out = tmp_path / "out"
    simulate_plan(plan, out)
    assert made
    sequence = load_simulated(out / "broad" / "run_tops.npz")
    for said, words in (
        ({"engine": "blender"}, "was simulated by blender, not by uvcloth.explicit"),
        ({"body_hash": "a"}, r"was simulated on another body \(broad\) than broad"),
    ):
        save_simulated(sequence.labelled(**said), out / "broad" / "run_tops.npz")
        with pytest.raises(InputError, match=rf"broad/run_tops\.npz: {words}"):
            simulate_plan(plan, out)


def test_a_faulty_capture_is_named_in_its_folder(
    plan: Path, made: list[Job], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        planning, "find_jump", lambda clip, first: "Hips turn" if clip.name == "run" else None
    )
    out = tmp_path / "out"
    simulate_plan(plan, out)
    assert "run" not in {job.motion.name for job in made}
    assert refused_captures(out) == refused_captures(out / "broad") == {"run": "Hips turn"}


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("walk,walk,40,30\n", "row 2: names no garments"),
        (WALK.replace("40,", "x,"), "row 2: the start is 'x', expected a whole number, 0 to"),
        (WALK.replace(",30,", ",0,"), "row 2: the frames is '0', expected a whole number, 1 to"),
        (WALK.replace(",30,,", ",30,nan,"), "row 2: the hold is 'nan', expected 0 to 60 seconds"),
        (WALK.replace("tops,,,", "tops,,4,"), "row 2: the member is '4', expected a whole number, 0 to 3"),
        (WALK.replace("train", "unused"), "row 2: the split is 'unused', expected train, validation, test"),
        (WALK.replace("tops", "tops+tops"), r"row 2: tops\+tops names a garment twice"),
        (WALK.replace(",walk,", ",a/b,"), "row 2: the clip 'a/b' cannot be part of a file's name"),
        (WALK.replace("tops,,", "tops,a/layered.npz,"), "row 2: a body cannot be named layered"),
        (WALK + WALK, r"row 3: makes walk_tops\.npz, which row 2 already makes"),
        (
            WALK + WALK.replace("tops", "dress").replace("40,30", "41,30"),
            "row 3: row 2 gives the name walk to another motion",
        ),
        (
            WALK + ",run,0,40,,tops,,,test,ann,running\n",
            "row 3: person ann is in two splits, test here and train in row 2",
        ),
        (
            WALK.replace("tops,", "tops,a/tall.npz") + WALK.replace("tops,", "dress,b/tall.npz"),
            r"row 3: its body has the same name as a/tall\.npz in row 2",
        ),
        (
            ROWS[2] + ",run,20,40,,bottoms+dress,,,test,bob,running\n",
            "row 3: wears bottoms as bottoms under dress, row 2 as bottoms under tops; a data folder",
        ),
    ],
)
def test_a_plan_that_cannot_be_is_refused_with_its_row(tmp_path: Path, rows: str, words: str) -> None:
    (tmp_path / "plan.csv").write_text(HEADER + rows)
    with pytest.raises(InputError, match=rf"plan\.csv: {words}"):
        read_plan(tmp_path / "plan.csv")


def test_a_table_that_is_no_plan_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plan.csv"
    for text, words in (
        ("clip,start\n", r"lacks the column frames, garments, split, subject, action"),
        (HEADER, "plans nothing, it has no row"),
        (b"\xff\xfe\x00", "not a table of text"),
    ):
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        with pytest.raises(InputError, match=rf"plan\.csv: {words}"):
            read_plan(path)
    with pytest.raises(InputError, match=r"gone\.csv"):
        read_plan(tmp_path / "gone.csv")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda row: row.replace(",walk,", ",gone,"), "lacks the clip gone"),
        (lambda row: row.replace("40,30", "40,300"), "walk: has .* frames, the window ends at 340"),
        (lambda row: row.replace("tops", "kilt"), "garment kilt: no such template, expected one of tops, "),
        (lambda row: row.replace("tops", "kilt.obj"), r"kilt\.obj: no such file"),
        (lambda row: row.replace("tops,,", "tops,gone.npz,"), r"gone\.npz: no such file"),
        (lambda row: row.replace("tops,,", "tops,../gone.npz,"), "lies outside"),
    ],
)
def test_what_a_row_names_has_to_be_there_before_anything_is_simulated(
    plan: Path, made: list[Job], tmp_path: Path, change: Callable[[str], str], words: str
) -> None:
    plan.write_text(HEADER + ROWS[4] + change(WALK))
    with pytest.raises(InputError, match=rf"plan\.csv: row 3: .*{words}"):
        simulate_plan(plan, tmp_path / "out")
    assert not made
    assert not (tmp_path / "out").exists()


def test_members_have_folders_of_their_own_and_need_the_explicit_engine(
    plan: Path, made: list[Job], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    monkeypatch.setitem(ENGINES, "blender", lambda: Blender("python", "4.5.15"))
    plan.write_text(HEADER + WALK.replace("tops,,,", "tops,,1,") + WALK)
    with pytest.raises(
        InputError, match=r"plan\.csv: row 2: ensemble members need the explicit engine, blender"
    ):
        simulate_plan(plan, out, options=SimulationOptions("blender"))
    simulate_plan(plan, out)
    assert _files(made, out) == ["walk_tops.npz", "members/1/walk_tops.npz"]
    assert [job.member for job in made] == [0, 1]
    assert list(read_index(out / "members" / "1" / "index.csv")) == ["walk"]
    assert read_metadata(out / "members" / "1" / "walk_tops.npz")["member"] == 1


def test_the_plan_of_our_data_is_whole(mocap_folder: Path) -> None:
    """Every window of the index on the default or another body, and nobody's motion in two splits."""
    rows = read_plan(Path(__file__).parents[2] / "benchmarks" / "plan.csv")
    index = read_index(mocap_folder / "index_v2.csv")
    for split, count in (("train", 149), ("validation", 8), ("test", 12)):
        windows = {row.motion.entry for row in rows if row.motion.split == split}
        known = [entry for entry in windows if entry.clip in index]
        assert len(known) == count
        assert all(replace(index[entry.clip], file="") == entry for entry in known)
    trained = {row.body for row in rows if row.motion.split == "train"}
    tested = {row.body for row in rows if row.motion.split == "test"}
    assert trained & tested == {""}
    assert (len(trained), len(tested)) == (5, 3)
    assert len({row.motion for row in rows if row.motion.hold}) == 10
