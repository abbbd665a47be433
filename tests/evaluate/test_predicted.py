"""Sequences of other programs: an exported simulation brought back has no error, a shifted one the shift."""

import os
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import evaluate.selection as selecting
from evaluate.__main__ import main
from evaluate.compare import compare
from evaluate.predicted import covered, load_predictions
from evaluate.records import Records
from evaluate.selection import Selection, cases_on
from tests.evaluate.test_compare import COUNTED, FPS, SETTLING, capsule_body, simulated, tube_garment
from uvcloth.bodies.body import Body
from uvcloth.commands.data import Data
from uvcloth.dataset.bodies import keep_body
from uvcloth.dataset.clip import SimulatedGarment
from uvcloth.dataset.clip_file import load_simulated, save_simulated
from uvcloth.dataset.predicted_file import read_prediction
from uvcloth.errors import InputError
from uvcloth.files.json_file import read_json
from uvcloth.garments.garment import Garment
from uvcloth.geometry.mesh import Mesh
from uvcloth.writers.animation import Animation
from uvcloth.writers.benchmark import export_benchmark
from uvcloth.writers.pointcache import write_pc2
from uvcloth.writers.usd import write_usd

pytestmark = pytest.mark.usefixtures("coarse_pixels")

SHIFT = np.array([0.0, 0.0, 0.01], np.float32)


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A tube that hangs 5 mm beside its rest shape on a moving capsule, as tops and as a dress."""

    def fitted(name: str, body: Body) -> Garment:
        return tube_garment(name)

    monkeypatch.setattr(selecting, "fit_template", fitted)
    monkeypatch.setattr(selecting, "garment_map", lambda *_: None)
    folder = tmp_path / "data"
    for name in ("tops", "dress"):
        clip = simulated(tube_garment(name), "02_04", torch.tensor([0.0, 0.0, 0.005]))
        save_simulated(clip, folder / f"02_04_{name}.npz")
    keep_body(capsule_body(), folder)
    return folder


def garment_of(data: Path) -> SimulatedGarment:
    return load_simulated(data / "02_04_tops.npz").garments[0]


def write_mdd(path: Path, points: np.ndarray) -> None:
    times = np.arange(len(points), dtype=">f4") / FPS
    header = struct.pack(">ii", *points.shape[:2]) + times.astype(">f4").tobytes()
    path.write_bytes(header + points.astype(">f4").tobytes())


def as_animation(points: np.ndarray, garment: SimulatedGarment, fps: float = FPS) -> Animation:
    mesh = Mesh(garment.rest, garment.faces, torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.long))
    return Animation(("tops",), (mesh,), (points,), None, np.zeros((len(points), 0, 3, 4), np.float32), fps)


def write_named_pc2(path: Path, points: np.ndarray, garment: SimulatedGarment) -> None:
    """A PC2 with its OBJ at rest beside it."""
    write_pc2(as_animation(points, garment), path.with_name("02_04.pc2"))
    for suffix in (".pc2", ".obj"):
        path.with_name(f"02_04-tops{suffix}").rename(path.with_suffix(suffix))


def test_an_exported_simulation_brought_back_has_no_error_and_a_shifted_one_the_shift(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("alembic3d", reason="alembic3d is not installed")
    out, shifted = tmp_path / "benchmark", tmp_path / "shifted"
    Data(data, export=out).run()
    assert "2 sequences written" in capsys.readouterr().out
    shifted.mkdir()
    garment = garment_of(data)
    moved = garment.vertices.numpy() + SHIFT
    np.savez(shifted / "02_04_tops.npz", vertices=moved, fps=FPS, ms_per_frame=7.5)
    # Another rollout of it, the same way off to the other side.
    (shifted / "members" / "1").mkdir(parents=True)
    np.savez(shifted / "members" / "1" / "02_04_tops.npz", vertices=garment.vertices.numpy() - SHIFT, fps=FPS)
    predicted = [f"usd={out / 'usd'}", f"abc={out / 'alembic'}", f"shifted={shifted}"]
    report = tmp_path / "report"
    arguments = ["--data", str(data), "--out", str(report), "--no-pictures", "--model", "lbs", "--predicted"]
    assert main([*arguments, *predicted]) == 0
    methods = read_json(report / "metrics.json", "metrics")["methods"]
    assert list(methods) == ["lbs", "usd", "abc", "shifted"]
    for name, garments in (("usd", {"tops", "dress"}), ("abc", {"tops", "dress"}), ("shifted", {"tops"})):
        cells = methods[name]["actions"]["02_04"]
        assert cells.keys() == garments
        for cell in cells.values():
            assert cell["frames"] == COUNTED
            expected = 10.0 if name == "shifted" else 0.0
            # The tube is off the body: clearing has nothing to move.
            for stage in ("_raw", ""):
                assert cell[f"vertex_mean_mm{stage}"] == pytest.approx(expected, abs=1e-3)
                assert cell[f"spread_ratio{stage}"] is None
            if name == "shifted":
                assert 7.5 < cell["network_ms"] < 30.0
            else:
                assert "ms_per_frame" not in cell
            assert cell["energy_score_mm"] == (pytest.approx(0.0, abs=1e-3) if name == "shifted" else None)
            assert cell["swing_ratio"] is not None


def test_what_blender_makes_of_the_benchmark_is_brought_back(data: Path, tmp_path: Path) -> None:
    python = os.environ.get("UVCLOTH_BLENDER_PYTHON")
    if not python:
        pytest.skip("needs UVCLOTH_BLENDER_PYTHON, a Python that has the package bpy")
    pytest.importorskip("alembic3d", reason="alembic3d is not installed")
    export_benchmark(data, tmp_path)
    garment = garment_of(data)
    script, file = Path(__file__).with_name("export_from_blender.py"), tmp_path / "alembic" / "02_04_tops.abc"
    command = [python, script, file, "tops", str(len(garment.vertices)), tmp_path / "02_04_tops"]
    # Its Python must not find our packages.
    clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    subprocess.run(command, check=True, capture_output=True, env=clean, timeout=100)
    for suffix in (".abc", ".usdc"):
        brought = read_prediction(tmp_path / f"02_04_tops{suffix}", garment, FPS)
        torch.testing.assert_close(brought, garment.vertices, atol=1e-6, rtol=0)


def test_the_benchmark_holds_the_body_as_it_moves(data: Path, tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom

    (data / "index.csv").write_text(
        "trial,subject,split,action,window_start,window_frames\n02_04,02,test,jump,0,9\n01_01,01,train,run,0,9\n"
    )
    save_simulated(simulated(tube_garment("tops"), "01_01", torch.zeros(3)), data / "01_01_tops.npz")
    Data(data, export=tmp_path).run()
    table = (tmp_path / "sequences.csv").read_text().splitlines()
    assert table[1:] == [
        f"02_04_{name},02_04,{name},{name},test,02,jump,capsule,{SETTLING + COUNTED},{SETTLING},30.0"
        for name in ("dress", "tops")
    ]
    stage = Usd.Stage.Open(str(tmp_path / "usd" / "02_04_tops.usdc"))
    baked = Usd.Stage.Open(stage.Flatten())
    from pxr import UsdSkel

    UsdSkel.BakeSkinning(baked.Traverse())
    points = np.array(UsdGeom.Mesh(baked.GetPrimAtPath("/Outfit/body/mesh")).GetPointsAttr().Get(5))
    transforms = load_simulated(data / "02_04_tops.npz").transforms[5, 0]
    expected = capsule_body().mesh.vertices @ transforms[:, :3].T + transforms[:, 3]
    np.testing.assert_allclose(points, expected, atol=1e-5)
    assert (tmp_path / "rest" / "02_04_tops.obj").is_file()


def test_garments_that_are_worn_together_are_judged_together(
    tmp_path: Path, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    layered, radius = tmp_path / "layered", {"dress": 0.18, "tops": 0.21}
    monkeypatch.setattr(selecting, "fit_template", lambda name, _: tube_garment(name, radius[name]))
    for name, wide in radius.items():
        clip = simulated(tube_garment(name, wide), "02_04", torch.tensor([0.0, 0.0, 0.005]))
        save_simulated(clip.labelled(layers=list(radius)), layered / f"02_04_{name}.npz")
    keep_body(capsule_body(), layered)
    export_benchmark(layered, tmp_path / "benchmark")
    predictions = load_predictions([f"usd={tmp_path / 'benchmark' / 'usd'}"], [])
    cases = cases_on(capsule_body(), Selection(layered, map_size=16))
    results, _ = compare((), cases, Records(tmp_path / "out", "a test", 0), predictions)
    cell = results["methods"]["usd"]["outfits"]["tops over dress"]["actions"]["02_04"]
    assert cell["vertex_mean_mm_raw"] == pytest.approx(0.0, abs=1e-3)
    assert cell["wrong_side_percent"]["tops"]["dress"] == 0.0


@pytest.mark.parametrize("suffix", [".npz", ".pc2", ".mdd", ".usda"])
def test_every_format_gives_the_points_in_their_order(data: Path, tmp_path: Path, suffix: str) -> None:
    garment, path = garment_of(data), tmp_path / f"02_04_tops{suffix}"
    points = garment.vertices.numpy() + SHIFT
    write = {
        ".npz": lambda: np.savez(path, tops_vertices=points, tops_faces=garment.faces, fps=FPS),
        ".pc2": lambda: write_named_pc2(path, points, garment),
        ".mdd": lambda: write_mdd(path, points),
        ".usda": lambda: write_usd(as_animation(points, garment), path),
    }
    write[suffix]()
    np.testing.assert_allclose(read_prediction(path, garment, FPS), points, atol=1e-6)


def test_a_usd_stage_in_centimetres_with_y_up_and_a_moved_parent_is_brought_to_the_world(
    data: Path, tmp_path: Path
) -> None:
    from pxr import Gf, Usd, UsdGeom

    garment, path = garment_of(data), tmp_path / "02_04_tops.usdc"
    write_usd(as_animation(garment.vertices.numpy()[..., [0, 2, 1]] * [100, 100, -100], garment), path)
    stage = Usd.Stage.Open(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.Xformable(stage.GetPrimAtPath("/Outfit")).AddTranslateOp().Set(Gf.Vec3d(0, 1, 0))
    stage.Save()
    np.testing.assert_allclose(
        read_prediction(path, garment, FPS), garment.vertices.numpy() + SHIFT, atol=1e-5
    )


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        (lambda p: {"vertices": p[1:]}, "has 19 frames, expected all 20 of the simulation, warm-up included"),
        (lambda p: {"vertices": p[:0]}, "holds no frame, expected 20"),
        (lambda p: {"vertices": p[:, 1:]}, r"has \d+ vertices, the garment tops has \d+"),
        (
            lambda p: {"vertices": np.where(np.arange(20)[:, None, None] == 3, np.nan, p)},
            "not a finite number",
        ),
        (lambda p: {"vertices": p[:, ::-1].copy(), "faces": "reversed"}, "mesh is of another order"),
        (lambda p: {"vertices": p[:, np.random.default_rng(0).permutation(p.shape[1])]}, "of another order"),
        (lambda p: {"vertices": 100 * p}, "in its first frame it is 100 times as large .* expected metres"),
        (lambda p: {"vertices": p[..., [0, 2, 1]] * [1, 1, -1]}, "axes look like Y up, expected Z up"),
        (lambda p: {"vertices": p, "fps": 24.0}, "has 24 frames per second, expected 30"),
        (lambda p: {"vertices": p, "rest": 100 * p[0]}, "at rest it is 100 times as large"),
        (lambda p: {"vertices": p, "rest": p[0] + 0.1}, r"at rest it is up to 1\d+ mm from the garment tops"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_sentence(
    data: Path, tmp_path: Path, changed: Callable[[np.ndarray], dict[str, Any]], says: str
) -> None:
    garment = garment_of(data)
    # Half a metre up, so that the axes matter.
    raised = SimulatedGarment("tops", garment.vertices + 0.5, garment.faces, garment.rest)
    arrays = changed(raised.vertices.numpy())
    if "faces" in arrays:
        arrays["faces"] = (torch.randperm(len(garment.rest))[garment.faces]).numpy()
    np.savez(tmp_path / "02_04_tops.npz", **arrays)
    with pytest.raises(InputError, match=rf"02_04_tops\.npz: .*{says}") as refused:
        read_prediction(tmp_path / "02_04_tops.npz", raised, FPS)
    assert "\n" not in str(refused.value)


def test_damaged_caches_are_refused_in_one_sentence(data: Path, tmp_path: Path) -> None:
    garment = garment_of(data)
    for suffix in (".pc2", ".mdd", ".usdc", ".abc"):
        path = tmp_path / f"02_04_tops{suffix}"
        path.write_bytes(b"POINTCACHE2\0" + bytes(range(1, 40)))
        with pytest.raises(InputError, match=rf"02_04_tops\{suffix}: "):
            read_prediction(path, garment, FPS)


def test_folders_are_checked_before_anything_is_judged(data: Path, tmp_path: Path) -> None:
    other = simulated(tube_garment("tops"), "12_01", torch.zeros(3))
    save_simulated(other, data / "12_01_tops.npz")
    some = tmp_path / "some"
    some.mkdir()
    cases = cases_on(capsule_body(), Selection(data, map_size=16))

    def judged() -> None:
        predictions = load_predictions([f"theirs={some}"], ["lbs"])
        compare((), cases, Records(tmp_path / "out", "a test", 0), predictions)

    with pytest.raises(InputError, match=r"some: lacks the sequence 02_04_"):
        judged()
    (some / "12_01_tops.pc2").touch()
    with pytest.raises(InputError, match=r"some: lacks the sequence 02_04_tops \(\.npz, "):
        judged()
    (some / "12_01_tops.mdd").touch()
    with pytest.raises(InputError, match=r"12_01_tops\.mdd beside it is of the same sequence"):
        judged()
    for option, says in (
        ("theirs", "expected NAME=DIR"),
        ("theirs=", "expected NAME=DIR"),
        (f"lbs={some}", "another method is called 'lbs'"),
        (f"simulation={some}", "another method is called 'simulation'"),
        (f"theirs={some / 'none'}", "no such folder"),
        (f"theirs={some}@varnish", "theirs@varnish: expected one of @dynamic"),
        (f"theirs={some}@fine", "only physics and the finishes"),
    ):
        with pytest.raises(InputError, match=says):
            load_predictions([option], ["lbs"])
    plain, finished = load_predictions([f"theirs={some}", f"theirs={some}@dynamic"], ["lbs"])
    assert [plain.name, finished.name, finished.folder] == ["theirs", "theirs@dynamic", some]
    assert plain.fingerprint != finished.fingerprint
    # The capsule has no limbs that the solver knows.
    (some / "12_01_tops.mdd").unlink()
    with pytest.raises(InputError, match=r"--predicted theirs@dynamic: body capsule: no joint"):
        covered([finished], cases.outfits, [("tops", cases.openers[-1].windows)])


def test_a_bad_file_stops_the_run_in_one_sentence_and_nothing_is_lost(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--data", str(data), "--out", str(tmp_path / "report"), "--no-pictures"]
    assert main(arguments) == 2
    assert "--model or --predicted" in capsys.readouterr().err
    theirs, garment = tmp_path / "theirs", garment_of(data)
    theirs.mkdir()
    points = garment.vertices.numpy()
    np.savez(theirs / "02_04_tops.npz", vertices=points, fps=FPS)
    np.savez(theirs / "02_04_dress.npz", vertices=points[:5], fps=FPS)
    assert main([*arguments, "--predicted", f"theirs={theirs}"]) == 2
    error = capsys.readouterr().err
    assert "02_04_dress.npz: has 5 frames, expected all 20" in error
    assert error.count("\n") == 1
    kept = {path.name.rpartition("_")[0] for path in (tmp_path / "report" / "partial").iterdir()}
    assert kept == {"02_04_tops_simulation", "02_04_tops_theirs", "02_04_dress_simulation"}
