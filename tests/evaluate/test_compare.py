"""The whole comparison on a made-up body and garment whose errors are known in advance."""

import json
import pickle
import shutil
import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
import torch
import trimesh
from torch import Tensor

import evaluate.selection as selecting
from evaluate import beside, records, workers
from evaluate.__main__ import machine, main
from evaluate.actions import find_windows
from evaluate.candidates import Candidate, load_candidates
from evaluate.case import Case
from evaluate.compare import compare
from evaluate.judge import CaseScores, judge
from evaluate.records import Records
from evaluate.report import write_report
from evaluate.selection import Selection, cases_on
from evaluate.show import Shown, pictures
from tests.dataset.altered import altered
from tests.train.simulated import save_clips
from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import BodyFrames
from uvcloth.checkpoint import WEIGHTS, TrainingData, save_checkpoint
from uvcloth.dataset.bodies import keep_body
from uvcloth.dataset.clip import SimulatedClip, clip_of_garment
from uvcloth.dataset.clip_file import load_simulated, save_simulated
from uvcloth.dataset.folder import keep_refused
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.geometry.skinning import skin
from uvcloth.methods.capabilities import Feedback, Representation
from uvcloth.methods.lbs import LBSConfig, create_lbs
from uvcloth.methods.method import Method, Traits
from uvcloth.methods.physxnet.config import PRESETS
from uvcloth.methods.physxnet.method import PhysXNet, physxnet_checkpoint

pytestmark = pytest.mark.usefixtures("coarse_pixels")

SETTLING = 8
FILE_MM = 0.05
"""How far a vertex read from a file may be from what was simulated."""
COUNTED = 12
MACHINE = f"{machine()}, threads used: 1"
FPS = 30.0
LBS = create_lbs(LBSConfig())


def capsule_body() -> Body:
    """A capsule with one joint."""
    shape = trimesh.creation.capsule(height=0.6, radius=0.15, count=[16, 16])
    vertices, faces = torch.tensor(shape.vertices).float(), torch.tensor(shape.faces).long()
    flat = torch.zeros(len(faces), dtype=torch.long)
    mesh = Mesh(vertices, faces, vertices[:, :2], faces)
    skeleton = Skeleton(("hips",), (-1,), torch.zeros(1, 3))
    return Body("capsule", mesh, skeleton, torch.ones(len(vertices), 1), flat, flat, {})


def tube_garment(name: str, radius: float = 0.18) -> Garment:
    """An open tube around the capsule, 3 cm off it."""
    shape = trimesh.creation.cylinder(radius=radius, height=0.5, sections=20)
    shape = shape.subdivide()
    upright = abs(shape.face_normals[:, 2]) < 0.5
    shape.update_faces(upright)
    shape.remove_unreferenced_vertices()
    vertices, faces = torch.tensor(shape.vertices).float(), torch.tensor(shape.faces).long()
    weights = torch.ones(len(vertices), 1)
    return Garment(name, name, Mesh(vertices, faces, vertices[:, :2], faces), weights, weights)


def motion(frames: int) -> Tensor:
    """A body that travels along a gentle curve: (frames, 1, 3, 4)."""
    time = torch.arange(frames) / FPS
    path = torch.stack([time, 0.1 * time**2, 0.02 * torch.sin(3 * time)], dim=-1)
    return torch.cat([torch.eye(3).expand(frames, 3, 3), path[:, :, None]], dim=-1)[:, None]


def simulated(garment: Garment, clip: str, off: Tensor) -> SimulatedClip:
    """A garment that hangs `off` metres beside its rest shape on the moving body."""
    transforms = motion(SETTLING + COUNTED)
    carried = skin(garment.mesh.vertices, garment.weights, transforms)
    body = capsule_body()
    metadata = {"clip": clip, "garment": garment.name, "template": garment.template}
    metadata |= {"body": body.name, "body_hash": body.identity.shape}
    return clip_of_garment(
        carried + off, garment.mesh.faces, garment.mesh.vertices, transforms, FPS, SETTLING, metadata
    )


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data folder of two actions and two templates, and templates that are tubes."""
    monkeypatch.setattr(selecting, "fit_template", lambda name, body: tube_garment(name))

    def every_vertex(garment: Garment, body: Body, size: int) -> tuple[Tensor, Tensor]:
        corners = torch.arange(len(garment.mesh.vertices))[:, None].expand(-1, 3)
        return corners, torch.tensor([[1.0, 0.0, 0.0]]).expand(len(corners), 3)

    monkeypatch.setattr(selecting, "garment_map", every_vertex)

    data = tmp_path / "data"
    for clip, off in (("02_04", 0.005), ("12_01", 0.010)):
        for name in ("tops", "dress"):
            garment = tube_garment(name)
            save_simulated(
                simulated(garment, clip, torch.tensor([0.0, 0.0, off])), data / f"{clip}_{name}.npz"
            )
    # One window has a second member of an ensemble, which hangs 2 mm apart.
    member = simulated(tube_garment("tops"), "02_04", torch.tensor([0.002, 0.0, 0.005]))
    save_simulated(member, data / "members" / "2" / "02_04_tops.npz")
    (data / "index.csv").write_text(
        "trial,subject,split,action,window_start,window_frames\n"
        "02_04,02,test,jump,0,9\n12_01,12,test,walking,0,9\n01_01,01,train,playground,0,9\n"
    )
    keep_body(capsule_body(), data)
    return data


@pytest.fixture
def skirt(world: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A garment file that moves like a dress, and a sequence of it in the world."""
    garment = replace(tube_garment("dress"), name="long_skirt")

    def from_file(file: str, *_: object) -> Garment:
        return replace(garment, name=Path(file).stem)

    monkeypatch.setattr(selecting, "load_garment_for_data", from_file)
    hanging = simulated(garment, "12_01", torch.tensor([0.0, 0.0, 0.02]))
    save_simulated(hanging, world / "12_01_long_skirt.npz")
    return "wardrobe/long_skirt.obj"


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of records for tests that judge the same: what one has judged the next takes over."""
    return tmp_path_factory.mktemp("records")


def run(
    data: Path,
    out: Path,
    actions: tuple[str, ...] = (),
    files: tuple[str, ...] = (),
    frames: int | None = None,
    body: Body | None = None,
    machine: str = MACHINE,
) -> dict:
    body = body or capsule_body()
    return compare(
        load_candidates(("lbs", "lbs_smooth"), body),
        cases_on(body, Selection(data, actions, files, frames, map_size=16)),
        Records(out, machine, 16),
    )[0]


def test_known_errors_come_out(world: Path, shared: Path) -> None:
    results = run(world, shared)
    assert list(results["methods"]) == ["lbs", "lbs_smooth"]
    cell = results["methods"]["lbs"]["actions"]["jump"]["tops"]
    assert cell["frames"] == COUNTED
    assert cell["vertex_mean_mm"] == pytest.approx(5.0, abs=FILE_MM)
    assert cell["vertex_mse_mm2"] == pytest.approx(25.0, abs=10 * FILE_MM)
    assert cell["map_mse_mm2"] == pytest.approx(25.0, abs=10 * FILE_MM)
    assert cell["inside_percent"] == 0.0
    assert cell["jitter_ratio"] == pytest.approx(1.0, rel=0.05)
    assert cell["ms_per_frame"] > 0
    walking = results["methods"]["lbs"]["actions"]["walking"]["dress"]
    assert walking["vertex_mean_mm"] == pytest.approx(10.0, abs=FILE_MM)
    assert results["methods"]["lbs"]["over_time_mm"]["tops"] == pytest.approx([7.5] * COUNTED, abs=FILE_MM)
    assert results["simulation"]["actions"]["jump"]["tops"]["vertex_mean_mm"] == 0.0
    steps = results["methods"]["lbs"]["stability"]["tops"]
    assert (
        steps["one_step_mm"] == steps["rollout_50_mm"] == steps["whole_mm"] == pytest.approx(7.5, abs=FILE_MM)
    )
    assert results["previous_frame"]["carried"]["tops"]["one_step_mm"] < 2 * FILE_MM
    assert results["previous_frame"]["held"]["tops"]["one_step_mm"] > 30.0
    json.dumps(results, allow_nan=False)


@dataclass(frozen=True)
class Rounded(Method, Representation):
    """The baseline, whose representation moves every garment by (off, off, off) m."""

    off: float
    name: str

    def prepare(self, outfit: Outfit, device: torch.device) -> Any:
        return LBS.prepare(outfit, device)

    def step(self, prepared: Any, state: Any, frames: BodyFrames) -> Any:
        return LBS.step(prepared, state, frames)

    def round_trip(self, prepared: Any, frames: BodyFrames, garments: tuple[Tensor, ...]) -> Any:
        assert len(frames) == len(garments[0])
        return tuple(vertices + self.off for vertices in garments)


def test_floors(world: Path, shared: Path) -> None:
    results = run(world, shared)
    assert results["floor"]["repeatability_mm"] == pytest.approx({"tops": 2.0}, abs=1e-3)
    assert results["floor"]["representation_mm"] == results["methods"]["lbs"]["representation"] == {}
    results, _ = compare(
        [Candidate(n, Rounded(off, n), 0.0, n, frozenset()) for n, off in (("near", 0.001), ("far", 0.002))],
        cases_on(capsule_body(), Selection(world, ("jump",), map_size=16)),
        Records(shared, MACHINE, 16),
    )
    root = 3**0.5
    assert results["floor"]["representation_mm"] == pytest.approx({"tops": root, "dress": root}, abs=1e-3)
    assert results["floor"]["representation_mse_mm2"]["dress"] == pytest.approx(3.0, abs=1e-2)
    own = results["methods"]["far"]["representation"]["dress"]
    own = {unit: own[unit] for unit in ("mm", "rmse_mm", "mse_mm2")}
    assert own == pytest.approx({"mm": 2 * root, "rmse_mm": 2 * root, "mse_mm2": 12.0}, abs=1e-2)


def test_rerun_takes_over_what_is_finished(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run(world, tmp_path / "out", ("jump",))

    def never(*_: object) -> Callable[..., None]:
        raise AssertionError("judged again")

    monkeypatch.setattr(records, "judge", never)
    assert run(world, tmp_path / "out", ("jump",)) == first
    with pytest.raises(AssertionError, match="judged again"):
        run(world, tmp_path / "out", ("jump",), frames=5)
    with pytest.raises(AssertionError, match="judged again"):
        run(world, tmp_path / "out", ("jump",), machine="another")
    wider = capsule_body()
    wider.mesh.vertices[:, 0] *= 1.1
    with pytest.raises(AssertionError, match="judged again"):
        run(world, tmp_path / "out", ("jump",), body=wider)
    monkeypatch.setattr(records, "SCORES_FORMAT", "another")
    with pytest.raises(AssertionError, match="judged again"):
        run(world, tmp_path / "out", ("jump",))


def test_actions_and_frames_narrow_it_down(world: Path, tmp_path: Path) -> None:
    results = run(world, tmp_path / "out", actions=("walking",), frames=7)
    assert results["actions"] == ["walking"]
    assert results["methods"]["lbs"]["actions"]["walking"]["tops"]["frames"] == 7


def test_missing_windows_are_listed_with_the_reason(world: Path, shared: Path) -> None:
    assert run(world, shared)["missing"] == {}
    exploded = simulated(tube_garment("dress"), "12_01", torch.tensor(torch.nan))
    exploded = exploded.labelled(rejected="frame 3: a vertex is not a finite number")
    (world / "12_01_dress.npz").unlink()
    save_simulated(exploded, world / "rejected" / "12_01_dress.npz")
    (world / "02_04_dress.npz").unlink()
    missing = {
        "jump": {"dress": "not simulated"},
        "walking": {"dress": "frame 3: a vertex is not a finite number"},
    }
    assert run(world, shared)["missing"] == missing
    assert run(world, shared, actions=("jump",))["missing"] == {"jump": missing["jump"]}
    keep_refused({"02_04": "LeftFoot turns by 167 degrees"}, world)
    missing["jump"] = {"dress": "LeftFoot turns by 167 degrees"}
    assert run(world, shared)["missing"] == missing


def test_a_folder_called_like_a_baseline_is_not_it(
    world: Path, shared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lbs").mkdir()
    monkeypatch.chdir(tmp_path)
    assert run(world, shared)["methods"]["lbs"]["weights_mb"] == 0.0


def test_a_trained_model_is_judged_on_the_real_body(body: Body, tmp_path: Path) -> None:
    """A network that predicts no change is the smooth baseline; what it was trained on is told apart."""
    data, folder = tmp_path / "data", tmp_path / "lbs_walker"
    save_clips(data, ("tops", "bottoms"), clips=2, frames=8)
    method = PhysXNet.untrained(PRESETS["tiny"])
    for parameter in method.net.parameters():
        parameter.data.zero_()
    seen = TrainingData(
        {"clip0_tops.npz": load_simulated(data / "clip0_tops.npz").files["clip0_tops.npz"]},
        {"train": {"clip0": ""}, "validation": {"clip1": ""}},
    )
    save_checkpoint(physxnet_checkpoint(method, body, seen, {"training_frames": 1434}), folder)
    results, _ = compare(
        load_candidates(("lbs_smooth", str(folder)), body),
        cases_on(body, Selection(data, frames=2, map_size=64)),
        Records(tmp_path / "out", MACHINE, 16),
    )
    walker, baseline = results["methods"]["lbs_walker"], results["methods"]["lbs_smooth"]
    assert (walker["baseline"], baseline["baseline"]) == (False, True)
    assert walker["trained_on"] == ["clip0_tops", "clip0_bottoms"]
    assert walker["chosen_on"] == ["clip1_tops"]
    assert [found["same"] for found in walker["familiar"].values()] == ["sequence", "clip", "clip"]
    assert baseline["trained_on"] == baseline["chosen_on"] == []
    assert results["split"] == "test"
    assert (walker["training_frames"], baseline["training_frames"]) == (1434, None)
    assert walker["weights_mb"] == (folder / WEIGHTS).stat().st_size / 1e6
    for action, template in (("clip0", "tops"), ("clip0", "bottoms"), ("clip1", "tops")):
        ours, theirs = (m["actions"][action][template] for m in (walker, baseline))
        assert ours["vertex_mean_mm"] == pytest.approx(theirs["vertex_mean_mm"], rel=1e-3)
        assert 0.0 < results["floor"]["representation_mm"][template] < 0.2 * theirs["vertex_mean_mm"]
    assert results["missing"] == {"clip1": {"bottoms": "not simulated"}}


@dataclass(frozen=True)
class ForOne(Method):
    """The baseline for one garment only."""

    garment: str
    name: str = "for_one"

    def unsupported_reason(self, outfit: Outfit) -> str:
        names = [garment.name for garment in outfit.garments]
        return "" if names == [self.garment] else f"garment {names[0]}: model for_one is for {self.garment}"

    def prepare(self, outfit: Outfit, device: torch.device) -> Any:
        assert not self.unsupported_reason(outfit)
        return LBS.prepare(outfit, device)

    def step(self, prepared: Any, state: Any, frames: BodyFrames) -> Any:
        return LBS.step(prepared, state, frames)


def judged(method: Method, data: Path, out: Path) -> tuple[dict, list[Shown]]:
    return compare(
        (*load_candidates(("lbs",), capsule_body()), Candidate(method.name, method, 0.0, "", frozenset())),
        cases_on(capsule_body(), Selection(data, map_size=16)),
        Records(out, MACHINE, 16),
    )


@dataclass(frozen=True)
class Sinking(Method, Feedback):
    """Brings the garment a millimetre nearer to the body's axis in every frame, from wherever it was left."""

    name: str = "sinking"
    traits = Traits(autoregressive=True)

    def prepare(self, outfit: Outfit, device: torch.device) -> Tensor:
        return outfit.garments[0].mesh.vertices

    def init(self, prepared: Tensor, frames: BodyFrames) -> Tensor:
        return prepared

    def step(self, prepared: Tensor, state: Tensor, frames: BodyFrames) -> Any:
        radius = state[:, :2].norm(dim=1, keepdim=True)
        nearer = torch.cat([state[:, :2] * (1 - 0.001 / radius), state[:, 2:]], dim=1)
        return nearer, (nearer[None] + frames.transforms[:, -1, 0, :, 3],)

    def feed_back(self, prepared: Tensor, state: Tensor, garments: tuple[Tensor, ...]) -> Tensor:
        vertices = garments[0][0]
        radius = vertices.sub(vertices.mean(0))[:, :2].norm(dim=1, keepdim=True)
        return torch.cat(
            [state[:, :2] * radius / state[:, :2].norm(dim=1, keepdim=True), state[:, 2:]], dim=1
        )


def test_before_the_finish_a_method_never_sees_what_it_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Alone it sinks by a millimetre a frame, into the body; what clearing leaves stays outside."""
    garment = tube_garment("tops", radius=0.163)
    monkeypatch.setattr(selecting, "fit_template", lambda name, body: garment)
    monkeypatch.setattr(selecting, "garment_map", lambda *_: None)
    save_simulated(simulated(garment, "02_04", torch.zeros(3)), tmp_path / "data" / "02_04_tops.npz")
    results, _ = judged(Sinking(), tmp_path / "data", tmp_path / "out")
    own = results["methods"]["sinking"]
    alone = [SETTLING + 1.0 + frame for frame in range(COUNTED)]
    assert own["over_time_mm_raw"]["tops"] == pytest.approx(alone, abs=0.05)
    cell = own["actions"]["02_04"]["tops"]
    assert cell["vertex_mse_mm2_raw"] == pytest.approx(sum(a * a for a in alone) / COUNTED, rel=0.01)
    assert cell["vertex_rmse_mm_raw"] == pytest.approx(cell["vertex_mse_mm2_raw"] ** 0.5)
    assert cell["vertex_mean_mm"] < 0.9 * cell["vertex_mean_mm_raw"]
    assert own["stability"]["tops"]["whole_mm_raw"] == pytest.approx(cell["vertex_mean_mm_raw"])
    assert own["stability"]["tops"]["one_step_mm_raw"] < 2.5


def test_a_method_is_judged_on_what_it_dresses(world: Path, shared: Path) -> None:
    results, shown = judged(ForOne("dress"), world, shared)
    own = results["methods"]["for_one"]
    assert own["actions"].keys() == {"jump", "walking"}
    assert all(by_garment.keys() == {"dress"} for by_garment in own["actions"].values())
    assert own["stability"].keys() == own["over_time_mm"].keys() == {"dress"}
    assert results["methods"]["lbs"]["stability"].keys() == {"tops", "dress"}
    assert results["windows"] == 4
    assert {"for_one" in each.meshes for each in shown if each.outfit_name == "tops"} == {False}
    drawn = pictures(shown, ["lbs", "for_one"], lambda jobs: (job.run() for job in jobs))
    assert "simulation, lbs;" in drawn[0].caption
    assert "simulation, lbs, for_one;" in drawn[1].caption


@pytest.mark.thorough
def test_the_frame_rate_is_that_of_most_windows(world: Path, tmp_path: Path) -> None:
    last = world / "12_01_dress.npz"
    save_simulated(replace(load_simulated(last), fps=60.0), last)
    assert run(world, tmp_path / "out", frames=3)["fps"] == FPS


def test_a_method_that_dresses_nothing_is_refused(world: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="data: nothing to evaluate for_one on: garment tops: model for_one"):
        judged(ForOne("cape"), world, tmp_path / "out")


def test_command_writes_metrics_and_page(
    world: Path, shared: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    out = tmp_path / "report"
    shutil.copytree(shared, out / "partial")
    arguments = ["--model", "lbs", "lbs_smooth", "--data", str(world), "--out", str(out)]
    assert main([*arguments, "--map-size", "16"]) == 0
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["methods"]["lbs"]["actions"]["jump"]["tops"]["frames"] == COUNTED
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert "7.5 mm" in capsys.readouterr().out


def test_processes_fill_the_records_that_are_compared(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def here(work: Callable, count: int, doing: str) -> Any:
        return nullcontext(lambda jobs: (work(pickle.loads(pickle.dumps(job))) for job in jobs))

    monkeypatch.setattr(workers, "pool", here)
    request = beside.Request(Selection(world, map_size=16), ("lbs",), (), 1)
    comparison = beside.load_comparison(request)
    # Four windows, on each the method and the simulation.
    monkeypatch.setattr(beside, "WORTH_A_PROCESS", 3)
    assert [beside.processes(comparison, jobs) for jobs in (1, 9)] == [1, 2]
    kept = Records(tmp_path, MACHINE, 16)
    with workers.workers(2) as work:
        beside.judge_beside(request, comparison, kept, work)
    for name in ("judge", "judge_simulation"):
        monkeypatch.setattr(records, name, lambda *_: pytest.fail("judged again"))
    results, _ = compare(comparison.candidates, comparison.cases, kept)
    assert results["methods"]["lbs"]["actions"]["jump"]["tops"]["frames"] == COUNTED


def test_validation_windows_are_judged_where_choices_are_made(world: Path, tmp_path: Path) -> None:
    index, out = world / "index.csv", tmp_path / "report"
    index.write_text(index.read_text().replace("12_01,12,test", "12_01,12,validation"))
    arguments = ["--model", "lbs", "--data", str(world), "--out", str(out), "--split", "validation"]
    assert main([*arguments, "--map-size", "16", "--no-pictures"]) == 0
    metrics = json.loads((out / "metrics.json").read_text())
    assert (metrics["split"], metrics["actions"], metrics["windows"]) == ("validation", ["walking"], 2)
    assert "2 simulated\nvalidation windows" in (out / "report.html").read_text()


def test_bad_input_is_one_sentence(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = ["--map-size", "16"]

    def refused(model: str, data: Path, *more: str) -> str:
        out = tmp_path / "refused"
        assert main(["--model", model, "--data", str(data), "--out", str(out), *small, *more]) == 2
        assert not (out / "report.html").exists()
        return capsys.readouterr().err

    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "jinja2", None)
        assert "install uvcloth[report]" in refused("lbs", world)
    assert "no such folder" in refused("lbs", tmp_path / "nowhere")
    assert "no test action is called 'swimming'" in refused("lbs", world, "--actions", "swimming")
    assert "--frames" in refused("lbs", world, "--frames", "0")
    assert "nosuchmodel" in refused("nosuchmodel", world)
    short = tmp_path / "short"
    garment = tube_garment("tops")
    sequence = simulated(garment, "a", torch.zeros(3))
    save_simulated(altered(sequence, warm_up=1000), short / "a_tops.npz")
    assert "a_tops.npz: was simulated on the body capsule, which is neither" in refused("lbs", short)
    keep_body(capsule_body(), short)
    assert "a_tops.npz: warm_up holds 1000, expected 0 to 19" in refused("lbs", short)
    save_simulated(altered(sequence, rest=1.2 * garment.mesh.vertices), short / "a_tops.npz")
    assert "another body" in refused("lbs", short)
    save_simulated(altered(sequence, faces=garment.mesh.faces.flip(1)), short / "a_tops.npz")
    assert "a_tops.npz: its mesh is not that of the garment tops" in refused("lbs", short)


def test_a_garment_from_a_file_is_judged_where_it_is_named(world: Path, skirt: str, shared: Path) -> None:
    assert run(world, shared)["garments"].keys() == {"tops", "dress"}
    results = run(world, shared, files=(skirt, "tops"))
    assert results["garments"].keys() == {"tops", "dress", "long_skirt"}
    cell = results["methods"]["lbs"]["actions"]["walking"]["long_skirt"]
    assert cell["vertex_mean_mm"] == pytest.approx(20.0, abs=FILE_MM)
    assert cell["map_mse_mm2"] == pytest.approx(400.0, abs=40 * FILE_MM)
    assert results["missing"] == {"jump": {"long_skirt": "not simulated"}}
    with pytest.raises(InputError, match=r"no test sequence of the garment cape \(CLIP_cape.npz\)"):
        run(world, shared, files=(skirt, "cape.obj"))
    with pytest.raises(InputError, match=r"other/long_skirt.obj: another one is also named long_skirt"):
        run(world, shared, files=(skirt, "other/long_skirt.obj"))
    sequence = load_simulated(world / "12_01_long_skirt.npz")
    save_simulated(
        altered(sequence, faces=sequence.garments[0].faces.flip(1)), world / "12_01_long_skirt.npz"
    )
    with pytest.raises(
        InputError, match=r"12_01_long_skirt\.npz: its mesh is not that of the garment long_skirt"
    ):
        run(world, shared, files=(skirt,))


@pytest.mark.thorough
def test_a_changed_file_is_judged_again(
    world: Path, skirt: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def judged_again() -> list[str]:
        names = []

        def counted(case: Case, candidate: Candidate) -> CaseScores:
            names.append(case.name)
            return judge(case, candidate)

        monkeypatch.setattr(records, "judge", counted)
        run(world, tmp_path / "out", files=(skirt,), frames=3)
        return names

    assert len(judged_again()) == 2 * 5
    assert judged_again() == []
    before = selecting.load_garment_for_data

    def turned(file: str, *more: object) -> Garment:
        garment = before(file, *more)  # type: ignore[arg-type]
        return replace(garment, mesh=replace(garment.mesh, uvs=garment.mesh.uvs.flip(1)))

    monkeypatch.setattr(selecting, "load_garment_for_data", turned)
    assert judged_again() == 2 * ["12_01_long_skirt"]


def test_a_garment_that_no_texel_sees_has_no_map(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(selecting, "garment_map", lambda *_: None)
    results = run(world, tmp_path / "out", ("jump",))
    assert results["methods"]["lbs"]["actions"]["jump"]["tops"]["map_mse_mm2"] is None
    assert results["floor"]["representation_mm"] == {}
    page = write_report(tmp_path, results, [], []).read_text()
    assert "tops: mean vertex distance" in page
    assert 'aria-label="tops: map mse"' not in page


def test_an_error_is_compared_with_the_spread_of_the_ensemble(world: Path, shared: Path) -> None:
    """LBS is 5 mm from one member and 5.4 from the other, which are 2 mm from each other."""
    jump = run(world, shared)["methods"]["lbs"]["actions"]["jump"]
    assert jump["tops"]["nearest_member_mm_raw"] == pytest.approx(5.0, abs=1e-3)
    assert jump["tops"]["ensemble_mm_raw"] == pytest.approx((5.0 + 29**0.5) / 2, abs=1e-3)
    assert jump["tops"]["spread_ratio_raw"] == pytest.approx((5.0 + 29**0.5) / 4, abs=1e-3)
    assert jump["dress"]["ensemble_mm"] is jump["dress"]["spread_ratio"] is None
    assert jump["tops"]["turned_max_mm"] < 0.01


def test_an_ensemble_with_a_missing_member_is_refused(world: Path, tmp_path: Path) -> None:
    """Member 1 of another window is there, so that this window's is missing; one that was refused is not."""
    other, lacking = (world / "members" / "1" / f"{name}.npz" for name in ("12_01_tops", "02_04_tops"))
    save_simulated(load_simulated(world / other.name), other)
    with pytest.raises(InputError, match=r"members/1/02_04_tops\.npz: is missing, while others"):
        run(world, tmp_path / "out", frames=1)
    save_simulated(load_simulated(world / lacking.name), lacking.parent / "rejected" / lacking.name)
    save_simulated(load_simulated(world / other.name), world / "members" / "2" / other.name)
    assert run(world, tmp_path / "out", frames=1)["windows"] == 4


def test_an_ensemble_member_of_another_motion_is_refused(world: Path, tmp_path: Path) -> None:
    other = simulated(tube_garment("tops"), "02_04", torch.zeros(3))
    bent = other.transforms.clone()
    bent[:-1, :, 0, 3] += 0.05
    save_simulated(replace(other, transforms=bent), world / "members" / "1" / "02_04_tops.npz")
    with pytest.raises(InputError, match=r"members/1/02_04_tops\.npz: has another motion"):
        run(world, tmp_path / "out")


def test_clips_are_found_by_the_longest_name_of_a_garment(tmp_path: Path) -> None:
    for stem in ("a_1_skirt", "a_2_long_skirt", "a_3_tops", "b_cape"):
        (tmp_path / f"{stem}.npz").touch()
    found = find_windows(tmp_path, (), ("tops", "skirt", "long_skirt"))
    assert [window.name for window in found] == ["a_1_skirt", "a_2_long_skirt", "a_3_tops"]
    assert [window.clip for window in found] == ["a_1", "a_2", "a_3"]


def test_windows_follow_the_index_or_the_files(world: Path) -> None:
    found = [(window.action, window.garment) for window in find_windows(world)]
    assert found == [("jump", "tops"), ("jump", "dress"), ("walking", "tops"), ("walking", "dress")]
    rows = (world / "index.csv").read_text()
    (world / "index.csv").write_text(rows.replace("12_01,12,test", "12_01,12,validation"))
    found = [(window.action, window.subject) for window in find_windows(world, split="validation")]
    assert found == [("walking", "12"), ("walking", "12")]
    assert {window.action for window in find_windows(world)} == {"jump"}
    (world / "index.csv").unlink()
    with pytest.raises(
        InputError, match=r"has no index\.csv, which is needed to find the clips for validation"
    ):
        find_windows(world, split="validation")
    assert {window.action for window in find_windows(world)} == {"02_04", "12_01"}
    (world / "index.csv").write_text("trial,action\n02_04,jump\n")
    with pytest.raises(InputError, match="lacks the column subject"):
        find_windows(world)
