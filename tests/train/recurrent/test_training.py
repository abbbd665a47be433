"""Recurrent rigs are trained on runs of the solver on a cage, which may come while they are trained."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from train.loop import fit
from train.recurrent.cage_runs import VALIDATION, CageRuns, load_run, run_files, save_run
from train.recurrent.objective import RecurrentObjective
from train.recurrent.run import LOOPS, LOSSES
from train.state import STATE
from uvcloth.bodies.body import Body
from uvcloth.checkpoint import load_checkpoint, load_tensors
from uvcloth.methods.recurrent.method import PRESETS, load_recurrent
from uvcloth.methods.registry import SHIPPED
from uvcloth.motion.index import INDEX

pytest.importorskip("lightning")

CLIPS = SHIPPED.parent / "clips"
WINDOWS = """trial,subject,split,action,window_start,window_frames,file
run,one,train,run,0,30,run.npz
again,two,validation,run,0,30,run.npz
"""
LOOP = replace(
    LOOPS["tiny"], steps=4, batch=2, validate_every=2, average=0.9, schedule="constant", learning_rate=5e-3
)
NETWORK = replace(PRESETS["tiny"], shapes=12, width=32)


def simulate(folder: Path) -> None:
    (folder.parent / INDEX).write_text(WINDOWS, encoding="utf-8")
    CageRuns(folder, "skirt", folder.parent / INDEX, CLIPS, runs=1).run()


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "skirt"
    simulate(folder)
    return folder


@pytest.fixture(scope="module")
def objective(data: Path, body: Body) -> RecurrentObjective:
    return RecurrentObjective(NETWORK, LOSSES["tiny"], [data], body)


def test_runs_that_are_there_are_kept(data: Path) -> None:
    (first,), (held_out,) = run_files(data), run_files(data / VALIDATION)
    assert (load_run(first).clip, load_run(first).subject, load_run(held_out).subject) == (
        "run",
        "one",
        "two",
    )
    times = [path.stat().st_mtime_ns for path in (first, held_out)]
    simulate(data)
    assert [path.stat().st_mtime_ns for path in (first, held_out)] == times


def test_shapes_give_back_the_cage(data: Path, objective: RecurrentObjective) -> None:
    """Of the run and of its mirror image, from where the body has stood still."""
    runs, run = objective.runs["skirt"], load_run(run_files(data)[0])
    window, still = LOSSES["tiny"].window, LOSSES["tiny"].unscored
    assert len(runs) == 2 * (len(run.offsets) + still - window + 1)
    _, weights = runs.draw(torch.tensor([0.0]))
    assert torch.equal(weights[0, :still], weights[:1, 0].expand(still, -1))
    resting = runs.fitted.mean + torch.einsum("tk,knc->tnc", weights[0, still:], runs.fitted.shapes)
    offsets = run.offsets[: window - still]
    apart = (runs.posed(resting, run.transforms[: window - still]) - offsets).norm(dim=-1)
    assert float(apart.mean()) < 0.25 * float(offsets.norm(dim=-1).mean())


def test_an_interrupted_training_goes_on_exactly(objective: RecurrentObjective, tmp_path: Path) -> None:
    fit(objective, tmp_path / "whole", LOOP, resume=False)
    fit(objective, tmp_path / "parts", replace(LOOP, steps=2), resume=False)
    fit(objective, tmp_path / "parts", LOOP, resume=True)
    whole, parts = (load_tensors(tmp_path / name / STATE)[0] for name in ("whole", "parts"))
    assert whole.keys() == parts.keys()
    for name, tensor in whole.items():
        assert torch.equal(tensor, parts[name]), name


def test_training_lowers_the_error_on_held_out_motion(objective: RecurrentObjective, tmp_path: Path) -> None:
    start = objective.validate(next(iter(objective.networks().values())))["mean_mm"]
    scores = fit(objective, tmp_path, replace(LOOP, steps=60, validate_every=60), resume=False)
    assert scores["mean_mm"] < 0.95 * start


def test_runs_that_come_are_learned_from_and_named_in_the_model(
    data: Path, body: Body, objective: RecurrentObjective, tmp_path: Path
) -> None:
    runs = objective.runs["skirt"]
    before, shapes = len(runs), runs.fitted.shapes
    first = load_run(run_files(data)[0])
    save_run(replace(first, clip="later"), data / "00001.npz")
    (net,) = objective.networks().values()
    objective.validate(net)
    assert len(runs) == 2 * before
    assert torch.equal(runs.fitted.shapes, shapes)
    objective.save(net, tmp_path, {})
    checkpoint = load_checkpoint(tmp_path, body)
    assert checkpoint.data.clips == {"train": {"run": "one", "later": "one"}, "validation": {"again": "two"}}
    assert list(load_recurrent(checkpoint, tmp_path).networks) == ["skirt"]
