"""Recurrent rigs are trained on runs of the solver on a cage, which may come while they are trained."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from train.loop import fit
from train.recurrent.cage_runs import VALIDATION, CageRuns, load_run, run_files
from train.recurrent.objective import RecurrentObjective
from train.recurrent.run import LOOPS, LOSSES
from train.recurrent.windows import GarmentRuns, Windows
from train.state import STATE
from uvcloth.bodies.body import Body
from uvcloth.checkpoint import load_checkpoint, load_tensors
from uvcloth.errors import InputError
from uvcloth.methods.recurrent.method import PRESETS, load_recurrent
from uvcloth.methods.registry import SHIPPED
from uvcloth.motion.index import INDEX

pytest.importorskip("lightning")

CLIPS = SHIPPED.parent / "clips"
WINDOWS = """trial,subject,split,action,window_start,window_frames,file
run,one,train,run,0,30,run.npz
again,two,validation,run,0,30,run.npz
"""
LOOP = replace(LOOPS["tiny"], steps=4, batch=2, validate_every=2, average=0.9)


def simulate(folder: Path, runs: int) -> None:
    (folder.parent / INDEX).write_text(WINDOWS, encoding="utf-8")
    CageRuns(folder, "skirt", folder.parent / INDEX, CLIPS, runs=runs).run()


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "skirt"
    simulate(folder, 1)
    return folder


def objective(data: Path, body: Body) -> RecurrentObjective:
    return RecurrentObjective(PRESETS["tiny"], LOSSES["tiny"], [data], body)


def test_runs_that_are_there_are_kept_and_missing_ones_made_again(data: Path, tmp_path: Path) -> None:
    shutil.copytree(data, tmp_path / "skirt")
    (first,) = run_files(tmp_path / "skirt")
    (held_out,) = run_files(tmp_path / "skirt" / VALIDATION)
    made, kept = load_run(first), held_out.stat().st_mtime_ns
    first.unlink()
    simulate(tmp_path / "skirt", 1)
    torch.testing.assert_close(load_run(first).offsets, made.offsets, atol=2e-3, rtol=0)
    assert held_out.stat().st_mtime_ns == kept
    assert (made.clip, made.subject, load_run(held_out).subject) == ("run", "one", "two")


def test_shapes_give_back_the_cage_and_its_mirror_image(data: Path, body: Body) -> None:
    runs = GarmentRuns(data, body, Windows(12, 4, mirror=True), shapes=20)
    runs.take_in()
    run = load_run(run_files(data)[0])
    assert len(runs) == 2 * (len(run.offsets) + 4 - 12 + 1)
    inputs, weights = runs.draw(torch.tensor([0.0]))
    fitted = runs.fitted
    resting = fitted.mean + torch.einsum("tk,knc->tnc", weights[0, 4:], fitted.shapes)
    apart = (runs.posed(resting, run.transforms[:8]) - run.offsets[:8]).norm(dim=-1)
    assert float(apart.mean()) < 0.25 * float(run.offsets[:8].norm(dim=-1).mean())
    assert inputs.shape == (1, 12, len(fitted.center))


def test_an_interrupted_training_goes_on_exactly(data: Path, body: Body, tmp_path: Path) -> None:
    fit(objective(data, body), tmp_path / "whole", LOOP, resume=False)
    fit(objective(data, body), tmp_path / "parts", replace(LOOP, steps=2), resume=False)
    fit(objective(data, body), tmp_path / "parts", LOOP, resume=True)
    whole, parts = (load_tensors(tmp_path / name / STATE)[0] for name in ("whole", "parts"))
    assert whole.keys() == parts.keys()
    for name, tensor in whole.items():
        assert torch.equal(tensor, parts[name]), name


def test_runs_that_come_are_taken_in_and_named_in_the_model(data: Path, body: Body, tmp_path: Path) -> None:
    shutil.copytree(data, tmp_path / "skirt")
    learning = objective(tmp_path / "skirt", body)
    (runs,) = learning.runs.values()
    before, shapes = len(runs), runs.fitted.shapes
    first = run_files(tmp_path / "skirt")[0]
    shutil.copyfile(first, first.with_name("00001.npz"))
    (net,) = learning.networks().values()
    learning.validate(net)
    assert len(runs) == 2 * before
    assert torch.equal(runs.fitted.shapes, shapes)
    learning.save(net, tmp_path / "model", {})
    checkpoint = load_checkpoint(tmp_path / "model", body)
    assert checkpoint.data.clips == {"train": {"run": "one"}, "validation": {"again": "two"}}
    assert "skirt" in load_recurrent(checkpoint, tmp_path / "model").networks


def test_training_lowers_the_error_on_held_out_motion(data: Path, body: Body, tmp_path: Path) -> None:
    config = replace(PRESETS["tiny"], shapes=12, width=32, dropout=0.0)
    learning = RecurrentObjective(config, LOSSES["tiny"], [data], body)
    start = learning.validate(next(iter(learning.networks().values())))["mean_mm"]
    scores = fit(
        learning, tmp_path, replace(LOOP, steps=60, validate_every=60, learning_rate=5e-3), resume=False
    )
    assert scores["mean_mm"] < 0.95 * start


def test_a_folder_without_runs_is_named(tmp_path: Path, body: Body) -> None:
    with pytest.raises(InputError, match=r"has no runs of a cage"):
        objective(tmp_path, body)
