"""Recurrent rigs are trained on runs of the solver on a cage, which may come while they are trained."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from train.loop import fit
from train.recurrent.cage_runs import (
    VALIDATION,
    CageRuns,
    load_run,
    reference_cage,
    run_files,
    save_run,
    simulate_cage,
)
from train.recurrent.objective import SLOW, RecurrentObjective, speed_error
from train.recurrent.run import LOOPS, LOSSES, RecurrentRun
from train.recurrent.windows import RunStatistics
from train.state import STATE
from uvcloth.bodies.body import Body, resized
from uvcloth.checkpoint import load_checkpoint, load_tensors
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.physics.outfit import PhysicsConfig, make_caged_outfit
from uvcloth.methods.recurrent.method import PRESETS, load_recurrent
from uvcloth.methods.registry import SHIPPED, load_method
from uvcloth.motion.index import INDEX
from uvcloth.motion.library import load_clip
from uvcloth.physics.fabric import JERSEY

pytest.importorskip("lightning_fabric")

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


@pytest.mark.thorough
def test_a_run_on_another_body_has_the_points_of_the_default_one(body: Body) -> None:
    """They hang below its own skinned garment by as much, a tenth more on a body a tenth larger."""
    reference = reference_cage("skirt", "fast")
    hanging = []
    for worn in (body, resized(body, 1.1)):
        prepared = make_caged_outfit(Outfit(worn, (fit_template("skirt", worn),)), PhysicsConfig("fast"))
        still = load_clip("run", worn).transforms()[:1].expand(3, -1, -1, -1)
        resting, skin, blend = simulate_cage(prepared, worn, still, reference)
        assert resting.shape == (3, *reference.vertices.shape)
        torch.testing.assert_close(blend.sum(1), torch.ones(len(blend)))
        gaps = (skin[..., :3] * resting).sum(-1) - skin[..., 3]
        assert -0.005 < float(gaps.min()) < 0.01  # At the waist cloth lies on the skin.
        torch.testing.assert_close(gaps[gaps > 0.06], torch.ones(int((gaps > 0.06).sum())))
        assert 0.0 < float((gaps > 0.06).float().mean()) < 1.0
        hanging.append(resting[-1])
    apart = (hanging[1] - 1.1 * hanging[0]).norm(dim=1).mean()
    assert float(apart) < 0.35 * float(hanging[1].norm(dim=1).mean())


def test_bodies_and_fabrics_are_drawn_for_half_of_the_training_alone(data: Path) -> None:
    other = Path("another.npz")
    runs = CageRuns(data, "skirt", data.parent / INDEX, CLIPS, bodies=(other,), fabrics=True)
    drawn = [runs.drawn("train", number) for number in range(200)]
    assert drawn == [runs.drawn("train", number) for number in range(200)]
    assert 70 < sum(file == other for file, _ in drawn) < 130
    assert 70 < sum(fabric != JERSEY for _, fabric in drawn) < 130
    assert {runs.drawn("validation", number) for number in range(20)} == {(None, JERSEY)}


def test_shapes_give_back_the_cage(data: Path, objective: RecurrentObjective) -> None:
    """Of the run and of its mirror image, from where the body has stood still."""
    runs, run = objective.runs["skirt"], load_run(run_files(data)[0])
    window, still = LOSSES["tiny"].window, LOSSES["tiny"].unscored
    assert len(runs) == 2 * (len(run) + still - window + 1)
    weights = runs.draw(torch.tensor([0.0])).weights
    assert torch.equal(weights[0, :still], weights[:1, 0].expand(still, -1))
    resting = runs.fitted.mean + torch.einsum("tk,knc->tnc", weights[0, still:], runs.fitted.shapes)
    offsets = run.resting[: window - still]
    assert float((resting - offsets).norm(dim=-1).mean()) < 0.25 * float(offsets.norm(dim=-1).mean())


def test_cloth_that_is_pushed_into_the_skin_is_inside_by_as_much(
    data: Path, objective: RecurrentObjective
) -> None:
    run, fitted = load_run(run_files(data)[0]), objective.runs["skirt"].fitted
    whole = RunStatistics(**vars(fitted) | {"mean": run.resting[5], "shapes": -run.skin[5:6, :, :3]})
    near = run.skin[5, :, :3].norm(dim=-1) > 0.9
    for depth in (0.0, 0.03):
        inside = whole.inside(torch.tensor([depth]), run.skin[5], 0.0)[near]
        gap = ((run.skin[5, :, :3] * run.resting[5]).sum(-1) - run.skin[5, :, 3])[near]
        slope = run.skin[5, near, :3].square().sum(-1)
        torch.testing.assert_close(inside, (depth * slope - gap).clamp(min=0.0), atol=1e-5, rtol=0)
    assert float(inside.max()) > 0.02


def test_the_error_of_the_speed_knows_no_direction_and_is_large_where_cloth_freezes() -> None:
    swing = 8.0 * torch.sin(torch.arange(40.0) / 5.0)[None, :, None] * torch.ones(3)
    assert float(speed_error(-swing, swing)) < 1e-6
    still, half = (float(speed_error(share * swing, swing)) for share in (0.0, 0.5))
    assert half == pytest.approx(0.5 * still, rel=0.1)
    assert 0.7 < still < 1.0
    slow = 0.01 * SLOW * swing / 8.0
    assert float(speed_error(0.0 * slow, slow)) < 0.01


def test_the_error_of_the_speed_is_a_loss_only_where_it_is_asked_for(
    data: Path, body: Body, objective: RecurrentObjective
) -> None:
    networks, rows = objective.networks(), torch.tensor([0, 1])
    losses = replace(LOSSES["tiny"], speed=3.0)
    asked = RecurrentObjective(NETWORK, losses, [data], body)
    parts = [next(each.steps(networks, rows))[2] for each in (objective, asked)]
    assert "skirt_speed" not in parts[0]
    assert float(parts[1]["skirt_speed"].detach()) > 0.0


def test_training_goes_on_from_a_model(data: Path, body: Body, tmp_path: Path) -> None:
    run = RecurrentRun(
        data=(data,), out=tmp_path / "first", network=NETWORK, losses=LOSSES["tiny"], loop=LOOP
    )
    run.train()
    further = replace(run, out=tmp_path / "second", start_from=str(tmp_path / "first"))
    further = replace(further, loop=replace(LOOP, steps=1, learning_rate=1e-9))
    further.train()
    first, second = (load_method(str(tmp_path / name), body) for name in ("first", "second"))
    before, after = (method.networks.state_dict() for method in (first, second))
    for name, tensor in before.items():
        torch.testing.assert_close(tensor, after[name], atol=1e-4, rtol=1e-3)
    with pytest.raises(InputError, match="is of other sizes"):
        replace(further, out=tmp_path / "third", network=PRESETS["tiny"]).train()


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
