"""Motion-guided trains in two stages, and continues at either exactly where it stopped."""

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Literal

import pytest
import torch

from tests.train.simulated import save_clips
from train.__main__ import main
from train.loop import fit
from train.motion_guided.dataset import GarmentDataset
from train.motion_guided.objective import (
    DynamicsObjective,
    MotionGuidedLosses,
    ShapeObjective,
    load_shape_space,
)
from train.motion_guided.run import LOOPS, LOSSES
from train.state import STATE
from uvcloth.bodies.body import load_body
from uvcloth.checkpoint import load_checkpoint, load_tensors
from uvcloth.errors import InputError
from uvcloth.methods.motion_guided.config import PRESETS
from uvcloth.methods.motion_guided.dynamics_input import (
    MEMORY,
    DynamicsInput,
    GarmentHistory,
    dynamics_features,
    posed_shape,
    rest_shape,
)
from uvcloth.methods.motion_guided.latent import Space
from uvcloth.methods.registry import load_method

pytest.importorskip("lightning_fabric")

LOOP = replace(LOOPS["tiny"], steps=4, validate_every=2, schedule="constant")
HALF = replace(LOOP, steps=2)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sequences")
    save_clips(folder, ("dress",), clips=3, frames=14, warm_up=4)
    save_clips(folder, ("dress",), clips=2, frames=14, warm_up=4)
    return folder


@cache
def dataset(data: Path, losses: MotionGuidedLosses = LOSSES["tiny"]) -> GarmentDataset:
    return GarmentDataset(PRESETS["tiny"], losses, [data])


def states(tmp_path: Path) -> tuple[dict[str, torch.Tensor], dict[str, torch.Tensor]]:
    whole, _ = load_tensors(tmp_path / "whole" / STATE)
    parts, _ = load_tensors(tmp_path / "parts" / STATE)
    assert whole.keys() == parts.keys()
    return whole, parts


def test_the_first_stage_resumes_exactly(data: Path, tmp_path: Path) -> None:
    fit(ShapeObjective(dataset(data), LOSSES["tiny"]), tmp_path / "whole", LOOP, resume=False)
    fit(ShapeObjective(dataset(data), LOSSES["tiny"]), tmp_path / "parts", HALF, resume=False)
    fit(ShapeObjective(dataset(data), LOSSES["tiny"]), tmp_path / "parts", LOOP, resume=True)
    whole, parts = states(tmp_path)
    for name, tensor in whole.items():
        assert torch.equal(tensor, parts[name]), name


@pytest.mark.parametrize("past", ["own", pytest.param("true", marks=pytest.mark.thorough)])
def test_the_second_stage_resumes_exactly(past: str, data: Path, tmp_path: Path) -> None:
    losses = replace(LOSSES["tiny"], past=past)
    fit(ShapeObjective(dataset(data, losses), losses), tmp_path / "shape", LOOP, resume=False)

    def objective() -> DynamicsObjective:
        return DynamicsObjective(
            dataset(data, losses), losses, load_shape_space(tmp_path / "shape", PRESETS["tiny"])
        )

    fit(objective(), tmp_path / "whole", LOOP, resume=False)
    fit(objective(), tmp_path / "parts", HALF, resume=False)
    fit(objective(), tmp_path / "parts", LOOP, resume=True)
    whole, parts = states(tmp_path)
    assert ("memory/past" in whole) == (past == "own")
    for name, tensor in whole.items():
        assert torch.equal(tensor, parts[name]), name


class Worsening(ShapeObjective):
    """Validates worse every time."""

    found = 0.0

    def validate(self, net: object) -> dict[str, float]:
        self.found += 1.0
        return {"mean_mm": self.found}


@pytest.mark.parametrize(("keep", "step"), [("best", 2), ("last", 4)])
def test_the_network_that_is_kept(
    keep: Literal["best", "last"], step: int, data: Path, tmp_path: Path
) -> None:
    objective = Worsening(dataset(data), LOSSES["tiny"])
    errors = fit(objective, tmp_path, replace(LOOP, keep=keep), resume=False)
    checkpoint = load_checkpoint(tmp_path)
    notes = checkpoint.notes
    assert errors["step"] == notes["step"] == step
    assert checkpoint.data.clips == {"train": {"clip0": ""}, "validation": {"clip1": ""}}
    assert notes["samples"] == len(objective.samples)
    assert notes["epochs"] == pytest.approx(step / (notes["samples"] // LOOP.batch), abs=0.01)
    assert notes["minutes"] > 0


def test_a_linear_space_holds_the_garments_it_was_fitted_to(data: Path) -> None:
    seen = GarmentDataset(replace(PRESETS["tiny"], size=32), LOSSES["tiny"], [data])
    space = ShapeObjective(seen, LOSSES["tiny"]).networks()["net"]
    frames, chosen = seen.training, seen.training.rows.samples
    with torch.no_grad():
        resting = rest_shape(space, seen.maps, seen.codes(space, frames, chosen))
        posed = posed_shape(space, seen.maps, resting, frames.pose[chosen])
        undisplaced = posed_shape(space, seen.maps, seen.maps.points.expand_as(posed), frames.pose[chosen])
    wrong, before = ((v - frames.vertices[chosen]).norm(dim=2).mean() for v in (posed, undisplaced))
    assert wrong < 0.3 * before


class Keeping(torch.nn.Module):
    """In place of the dynamic encoder: returns the garment that it was shown, and keeps what it saw."""

    def __init__(self, objective: DynamicsObjective) -> None:
        super().__init__()
        self.dynamics, self.space = objective.networks()["net"], objective.space

    def change(self, *seen: torch.Tensor) -> torch.Tensor:
        return self.dynamics.change(*seen)

    def forward(self, features: torch.Tensor, change: torch.Tensor) -> torch.Tensor:
        self.features, self.changes = features, change
        return self.space.encode(features[:, :3])


@pytest.fixture(scope="module")
def space(data: Path) -> Space:
    space: Space = ShapeObjective(dataset(data), LOSSES["tiny"]).networks()["net"]
    return space


def stepped(
    data: Path, space: Space, rows: torch.Tensor, **settings: object
) -> tuple[DynamicsObjective, Keeping, dict[str, torch.Tensor]]:
    """One step of `Keeping` on rows, after histories that are far from the simulation's."""
    losses = replace(LOSSES["tiny"], unroll=1, **settings)
    objective = DynamicsObjective(dataset(data, losses), losses, space)
    net = Keeping(objective)
    if losses.past == "own":
        objective.past += 0.1
        objective.past_offsets += 0.1
    ((_, _, parts),) = objective.steps({"net": net}, rows)
    return objective, net, parts


@pytest.mark.parametrize("past", ["own", "true"])
def test_the_virtual_sample_is_of_a_clip_that_stands_still(past: str, data: Path, space: Space) -> None:
    rows = torch.tensor([5, 8])
    objective, net, _ = stepped(data, space, rows, past=past)
    clips, maps, before = objective.dataset.training, objective.dataset.maps, rows - 1
    pose = clips.pose[before]
    standing = DynamicsInput(
        past=GarmentHistory(
            maps.positions(clips.vertices[before])[:, None].repeat(1, MEMORY, 1, 1),
            clips.offsets[before][:, None].repeat(1, MEMORY, 1, 1),
        ),
        transforms=pose.transforms[:, None].repeat(1, MEMORY, 1, 1, 1),
        seeds_before=pose.seeds,
        seeds=pose.seeds,
        fps=clips.rows.fps[before],
    )
    expected, _ = dynamics_features(space, net, maps, standing, objective.dataset.config.sigma)
    torch.testing.assert_close(net.features[2:], expected)
    assert (net.changes[2:] == 0).all()


@pytest.mark.parametrize("past", ["own", "true"])
def test_who_keeps_the_garment_loses_nothing_by_the_virtual_sample(
    past: str, data: Path, space: Space
) -> None:
    rows = torch.tensor([5, 8])
    objective, _, both = stepped(data, space, rows, past=past)
    _, _, real = stepped(data, space, rows, past=past, still=False)
    seen, before = objective.dataset, rows - 1
    kept = posed_shape(
        space, seen.maps, rest_shape(space, seen.maps, objective.codes[before]), seen.training.pose[before]
    )
    virtual = {name: 2.0 * both[name] - real[name] for name in ("shape", "code")}
    assert real["code"] > 1e-4
    torch.testing.assert_close(virtual["code"], torch.tensor(0.0), atol=1e-6, rtol=0)
    # What is left is what the space itself loses of the garment.
    torch.testing.assert_close(virtual["shape"], (kept - seen.training.vertices[before]).abs().mean())


def test_one_command_trains_both_stages(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = tmp_path / "run"
    command = f"train motion_guided --data {data} --out {run} --preset tiny --steps 4 --shape.steps 4"
    monkeypatch.setattr(sys, "argv", command.split())
    main()
    assert load_method(run, load_body()).name == "run"
    with pytest.raises(InputError, match="only the first stage"):
        load_method(run / "shape", load_body())
    with pytest.raises(InputError, match="--resume"):
        main()


def test_clips_of_several_folders_are_joined(data: Path) -> None:
    def scored(folders: list[Path]) -> int:
        read = GarmentDataset(PRESETS["tiny"], LOSSES["tiny"], folders)
        return len(read.training.rows.samples) + len(read.held.rows.samples)

    assert scored([data, data]) == 2 * scored([data])


def test_the_space_is_not_searched_for_depth_that_costs_nothing(data: Path) -> None:
    losses = replace(LOSSES["tiny"], inside=0.0)
    objective = ShapeObjective(dataset(data, losses), losses)
    ((_, _, parts),) = objective.steps(objective.networks(), objective.samples[:2])
    assert parts["inside"] == 0.0
    assert "skin" not in vars(objective.dataset)


def test_training_needs_the_garment(data: Path) -> None:
    with pytest.raises(InputError, match="tops"):
        GarmentDataset(replace(PRESETS["tiny"], garment="tops"), LOSSES["tiny"], [data])
