"""Planning, and keeping apart."""

from concurrent.futures import Future
from contextlib import nullcontext
from dataclasses import asdict
from datetime import datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
import torch
from dask.distributed import KilledWorker
from distributed.client import FutureCancelledError
from rich.progress import Progress

from tests.dataset.altered import altered
from tests.simulation.skinned import skinned_sequence
from uvcloth.bodies.body import Body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.dataset.folder import refused_captures
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.garments.joined import EngineMesh
from uvcloth.garments.templates import fit_template
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import load_clip
from uvcloth.physics.fabric import FABRICS, Fabric
from uvcloth.simulation import batch, quality_check
from uvcloth.simulation import plan as planning
from uvcloth.simulation.batch import simulate_batch
from uvcloth.simulation.blender import Blender
from uvcloth.simulation.engines import ENGINES
from uvcloth.simulation.explicit import Explicit
from uvcloth.simulation.options import SimulationOptions
from uvcloth.simulation.plan import ClipSelection, Job
from uvcloth.simulation.progress import FramesBar, progress_text
from uvcloth.simulation.quality_check import MAX_INSIDE_PERCENT, examine
from uvcloth.simulation.workers import Workers, forgotten

HEADER = "trial,subject,split,action,window_start,window_frames\n"


@pytest.fixture(scope="module")
def shirt(body: Body) -> Garment:
    return fit_template("tops", body)


@pytest.fixture(scope="module")
def skinned(shirt: Garment, body: Body) -> SimulatedClip:
    """A shirt that is simply skinned: outside the body for a small motion."""
    return skinned_sequence(shirt, body)


def test_exploded_and_swallowed_sequences_are_refused(
    skinned: SimulatedClip, shirt: Garment, body: Body
) -> None:
    torn = skinned.vertices.clone()
    torn[2, 100] += 5.0
    assert "frame 2" in str(examine(altered(skinned, vertices=torn), [shirt], body)[1])
    lost = skinned.vertices.clone()
    lost[3, 0, 0] = float("nan")
    assert "finite" in str(examine(altered(skinned, vertices=lost), [shirt], body)[1])
    hips = skinned.transforms[:, :1, :, :3] @ body.skeleton.heads[0] + skinned.transforms[:, :1, :, 3]
    # All but the sleeves: arms stay in their cuffs.
    shrunk = (0.3 + 6.0 * shirt.mesh.vertices[:, :1].abs()).clamp(max=1.0)
    sunken = hips + shrunk * (skinned.vertices - hips)
    seen, reason = examine(altered(skinned, vertices=sunken), [shirt], body)
    assert "inside the body" in str(reason)
    assert seen.garments[0].metadata["inside_percent"] > MAX_INSIDE_PERCENT


def test_a_sleeve_that_came_off_its_arm_is_refused(
    skinned: SimulatedClip, shirt: Garment, body: Body
) -> None:
    assert examine(skinned, [shirt], body)[0].garments[0].metadata["left_percent"] == 0.0
    names = body.skeleton.names
    shoulder, elbow = (body.skeleton.heads[names.index(name)] for name in ("LeftArm", "LeftForeArm"))
    along = torch.nn.functional.normalize(elbow - shoulder, dim=0)
    rest = shirt.mesh.vertices
    reach = (rest - shoulder) @ along
    beside = (rest - shoulder - reach[:, None] * along).norm(dim=1)
    sleeve = (rest[:, 0] > 0.0) & (beside < 0.1)
    slid = skinned.vertices.clone()
    slid[2:, :, 0] += 0.2 * sleeve * ((reach - 0.08) / 0.06).clamp(0.0, 1.0)
    assert "a limb has left its cloth in 67 %" in str(
        examine(altered(skinned, vertices=slid), [shirt], body)[1]
    )


def test_a_shirt_that_runs_through_itself_is_refused(
    skinned: SimulatedClip, shirt: Garment, body: Body, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert examine(skinned, [shirt], body)[0].garments[0].metadata["crossing_percent"] < 1.0
    monkeypatch.setattr(quality_check, "MAX_INSIDE_PERCENT", 100.0)
    noise = torch.randn(skinned.vertices.shape, generator=torch.Generator().manual_seed(0))
    crumpled = altered(skinned, vertices=skinned.vertices + 0.01 * noise)
    assert "% of the edges run through the garment itself" in str(examine(crumpled, [shirt], body)[1])


@pytest.fixture
def finished(skinned: SimulatedClip, body: Body, tmp_path: Path) -> Path:
    """A folder in which the sequence of one window is there, so that nothing is left to simulate."""
    (tmp_path / "mine.csv").write_text(HEADER + "walk,a,test,walking,40,30\n")
    out = tmp_path / "out"
    out.mkdir()
    save_simulated(skinned, out / "walk_tops.npz")
    simulate_batch(ClipSelection(["walk"], tmp_path / "mine.csv"), [["tops"]], out, body)
    return out


def test_windows_are_kept_with_the_sequences_and_others_are_refused(
    finished: Path, body: Body, tmp_path: Path
) -> None:
    mine = tmp_path / "mine.csv"
    assert (finished / "index.csv").read_text() == mine.read_text()
    simulate_batch(ClipSelection(["walk"], mine), [["tops"]], finished, body)
    mine.write_text(HEADER + "walk,a,train,walking,40,30\n")
    with pytest.raises(InputError, match=r"out/index\.csv: holds other windows than .*mine\.csv"):
        simulate_batch(ClipSelection(["walk"], mine), [["tops"]], finished, body)
    assert "test" in (finished / "index.csv").read_text()


def test_what_was_simulated_alone_is_not_taken_for_a_layer(finished: Path, body: Body) -> None:
    with pytest.raises(InputError, match=r"walk_tops\.npz: was simulated as tops, not as bottoms under tops"):
        simulate_batch(ClipSelection(["walk"]), [["bottoms", "tops"]], finished, body)


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"body_hash": "a", "body": "tall"}, r"was simulated on another body \(tall\) than default"),
        ({"engine": "blender"}, r"was simulated by blender, not by uvcloth\.explicit"),
        (
            {"engine": Explicit.name, "settings": asdict(Explicit(fabric=Fabric(density=5.0)))},
            rf"was simulated with other settings \(density 5\.0 instead of {Fabric.density}\)",
        ),
    ],
)
def test_data_of_another_body_or_engine_are_refused(
    finished: Path, body: Body, skinned: SimulatedClip, said: dict, words: str
) -> None:
    other = skinned.labelled(clip="run", **said)
    save_simulated(other, finished / "rejected" / "run_dress.npz")
    with pytest.raises(InputError, match=rf"run_dress\.npz: {words}.*simulate into another folder"):
        simulate_batch(ClipSelection(["walk"]), [["tops"]], finished, body)


def test_a_job_is_simulated_in_a_fabric_of_its_own(
    monkeypatch: pytest.MonkeyPatch, body: Body, tmp_path: Path
) -> None:
    engines: list[Explicit] = []

    def simulated(*arguments: object) -> None:
        engines.append(cast("Explicit", arguments[4]))
        raise InputError("enough")

    monkeypatch.setattr(batch, "simulate", simulated)
    for fabric in (None, FABRICS["denim"]):
        job = Job(load_clip("walk", body), 0, body, (), (tmp_path / "a.npz",), fabric)
        batch._simulate_job(job, Explicit(hold=7.0), tmp_path, tmp_path)
    assert engines == [Explicit(hold=7.0), Explicit(hold=7.0, fabric=FABRICS["denim"])]


def test_data_of_this_body_and_engine_are_added_to(
    finished: Path, body: Body, skinned: SimulatedClip
) -> None:
    said = {"body_hash": body.identity.shape, **Explicit().describe()}
    save_simulated(skinned.labelled(**said), finished / "rejected" / "run_tops.npz")
    simulate_batch(ClipSelection(["walk", "run"]), [["tops"]], finished, body)


def test_a_faulty_capture_is_reported_and_the_others_go_on(
    finished: Path, body: Body, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(
        planning, "find_jump", lambda clip, first: "LeftFoot turns" if clip.name == "run" else None
    )
    made: list[Job] = []
    monkeypatch.setattr(batch, "simulate_all", lambda todo, *_: made.extend(todo))
    simulate_batch(ClipSelection(["walk", "run", "jump"]), [["tops"]], finished, body)
    assert [job.motion.name for job in made] == ["jump"]
    assert "run: refused, LeftFoot turns" in caplog.messages
    assert refused_captures(finished) == {"run": "LeftFoot turns"}


def test_what_cannot_be_simulated_is_named_and_the_others_go_on(
    skinned: SimulatedClip, body: Body, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The solver follows no body at 40 m/s: a command for a whole night must not end with such a clip."""

    def simulated(clip: Clip, *_: object) -> SimulatedClip:
        if clip.name == "run":
            raise InputError("the body moves at 90 m/s")
        return altered(skinned, {"wall_seconds": 1.0, "inside_percent": 0.0})

    monkeypatch.setattr(batch, "simulate", simulated)
    monkeypatch.setattr(batch, "examine", lambda clip, *_: (clip, None))
    client = SimpleNamespace(subscribe_topic=lambda *_: None)
    monkeypatch.setattr(batch, "connected", lambda *_: nullcontext(client))
    monkeypatch.setattr(batch, "results", lambda _, todo, work, look: ((job, work(job)) for job in todo))
    worn = (cast("EngineMesh", SimpleNamespace(garment=None)),)
    jobs = [
        Job(load_clip(name, body), 0, body, worn, (tmp_path / f"{name}_tops.npz",))
        for name in ("run", "walk")
    ]
    batch.simulate_all(jobs, 200, Explicit(), Workers(jobs=1), tmp_path)
    assert refused_captures(tmp_path) == {"run_tops": "the body moves at 90 m/s"}
    assert (tmp_path / "walk_tops.npz").is_file()


def test_the_end_is_predicted_from_the_speed_of_all_workers() -> None:
    clock = iter(range(1000)).__next__
    progress = Progress(get_time=lambda: 2.0 * clock(), disable=True, speed_estimate_period=3600.0)
    task = progress.add_task("", total=7203)
    now = datetime(2026, 11, 22, 13, 0)
    assert progress_text(progress.tasks[0], now) == "measuring"
    for _ in range(3):
        progress.advance(task, 1)
    seconds_per_frame = 1.0 / progress.tasks[0].speed
    end = now + timedelta(seconds=7200 * seconds_per_frame)
    assert progress_text(progress.tasks[0], now).startswith("3 of 7203 frames")
    assert progress_text(progress.tasks[0], now).endswith(f"done {end:%a %d %b %H:%M}")
    assert seconds_per_frame == pytest.approx(2.0, rel=0.5)


def test_frames_that_were_kept_or_lost_change_what_is_left(capsys: pytest.CaptureFixture[str]) -> None:
    bar = FramesBar(100)
    for made in (0, 1, 2):
        bar.report("walk_dress", made)
    bar.report("run_dress", 40)
    assert (bar.task.completed, bar.task.total) == (2, 60)
    bar.report("walk_dress", 0)
    assert (bar.task.completed, bar.task.total) == (2, 62)
    assert capsys.readouterr().out == "run_dress: continues after frame 40\n"


def test_garments_that_would_share_files_are_refused(body: Body, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="garment tops: another one is also named tops"):
        simulate_batch(ClipSelection(["walk"]), [["tops"], ["tops"]], tmp_path, body)
    assert not list(tmp_path.iterdir())


def test_an_even_mesh_is_refused_where_the_engine_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ENGINES, "blender", lambda: Blender("python", "4.5.15"))
    with pytest.raises(InputError, match=r"--edge 0\.012: needs the explicit engine, blender simulates"):
        SimulationOptions("blender", edge=0.012).make_engine()


def test_places_and_numbers_that_cannot_be_are_refused(body: Body, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: cannot be made a folder"):
        simulate_batch(ClipSelection(["walk"]), [["tops"]], tmp_path / "file", body)
    with pytest.raises(InputError, match="--jobs 0: expected at least 1"):
        SimulationOptions(workers=Workers(jobs=0)).make_engine()
    nowhere = SimulationOptions(workers=Workers(scheduler="nowhere"))
    with pytest.raises(InputError, match="--scheduler nowhere: no dask scheduler answers there"):
        simulate_batch(ClipSelection(["walk"]), [["tops"]], tmp_path / "out", body, options=nowhere)


def test_a_job_that_is_forgotten_is_told_from_one_that_kills_its_workers() -> None:
    """Processes that are paused for long, as by a laptop that sleeps, are forgotten."""
    job, paused, killed = cast(Job, SimpleNamespace(motion=SimpleNamespace(name="walk"))), Future(), Future()
    paused.set_exception(FutureCancelledError("simulate-1", "lost"))
    killed.set_exception(KilledWorker("simulate-1", None, 3))
    assert forgotten(paused, job)
    with pytest.raises(InputError, match=r"walk: every process that simulated it has ended .* run the comm"):
        forgotten(killed, job)
