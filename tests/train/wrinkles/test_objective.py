"""Training of wrinkles on a few frames of a strip: losses, resume, and what is refused."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from tests.small_body import small_body
from tests.wrinkles.strip import garment, strip
from train.loop import LoopConfig, fit
from train.wrinkles import objective as objective_module
from train.wrinkles import tracked_runs
from train.wrinkles.objective import WrinkleLosses, WrinkleObjective
from train.wrinkles.tracked_runs import TrackedRun, fine_mesh, fine_mesh_name, load_run, save_run
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.wrinkles.model import load_wrinkles
from uvcloth.wrinkles.network import WrinkleConfig, WrinkleNet

CONFIG = WrinkleConfig(size=64, width=4, levels=2)
FRAMES = 6
CPU = torch.device("cpu")


@pytest.fixture
def cloth(monkeypatch: pytest.MonkeyPatch) -> Garment:
    made = garment(strip())
    for module in (objective_module, tracked_runs):
        monkeypatch.setattr(module, "load_garment", lambda name, body: made)
    return made


@pytest.fixture
def data(tmp_path: Path, cloth: Garment) -> Path:
    """Runs in which folds follow the bending of the strip."""
    folder = tmp_path / "data"
    folder.mkdir()
    fine, _ = fine_mesh(cloth, folder, 0.03)
    for split, person in (("train", "a"), ("validation", "b")):
        (folder / split).mkdir()
        coarse = torch.stack([strip(curvature=1.0 + 0.2 * frame).vertices for frame in range(FRAMES + 2)])
        wave = 0.004 * (40.0 * fine.rest[:, 0]).sin()[:, None] * torch.tensor([0.0, 0.0, 1.0])
        save_run(
            TrackedRun(
                garment=cloth.name,
                quality="default",
                clip=f"clip_{person}",
                subject=person,
                mesh=fine_mesh_name(fine),
                fps=30.0,
                edge=0.03,
                transforms=torch.eye(3, 4).expand(FRAMES, 2, 3, 4).clone(),
                coarse=coarse,
                offsets=wave * torch.linspace(0.5, 1.5, FRAMES)[:, None, None],
            ),
            folder / split / f"clip_{person}.npz",
        )
    return folder


def new_objective(data: Path, losses: WrinkleLosses | None = None) -> WrinkleObjective:
    return WrinkleObjective(CONFIG, losses or WrinkleLosses(), [data], small_body(), CPU)


def test_a_run_comes_back(data: Path) -> None:
    run = load_run(data / "train" / "clip_a.npz")
    assert (run.clip, run.subject, len(run)) == ("clip_a", "a", FRAMES)
    assert run.coarse.shape[0] == FRAMES + 2


def test_training_finds_the_folds_and_the_checkpoint_makes_them(data: Path, tmp_path: Path) -> None:
    objective = new_objective(data)
    loop = LoopConfig(steps=60, batch=4, learning_rate=1e-2, validate_every=60, average=0.0, keep="last")
    scores = fit(objective, tmp_path / "run", loop, resume=False)
    assert scores["unexplained"] < 0.5
    assert 0.5 < scores["strength"] < 1.5
    again = load_wrinkles(tmp_path / "run")
    assert objective.validate(again.net)["unexplained"] == pytest.approx(scores["unexplained"], abs=0.01)


def test_a_network_that_makes_nothing_explains_nothing(data: Path) -> None:
    objective = new_objective(data)
    net = objective.networks()["net"]
    # Before it is trained, it makes the mean of the training.
    assert objective.validate(net)["unexplained"] < 0.7
    assert isinstance(net, WrinkleNet)
    torch.nn.init.zeros_(net.mean)
    scores = objective.validate(net)
    assert scores["unexplained"] == pytest.approx(1.0)
    assert scores["popping"] == pytest.approx(1.0)
    assert scores["strength"] == 0.0


def test_the_true_displacements_have_no_loss(data: Path) -> None:
    objective = new_objective(data)
    real = torch.randn(4, 3, 64, 64) * objective.mask
    assert all(float(part) == 0.0 for part in objective.parts(real, real).values())
    # A displacement that is wrong by the same everywhere has no wrong slopes and no wrong change.
    parts = objective.parts((real + 1.0) * objective.mask, real)
    assert float(parts["l1"]) == pytest.approx(1.0)
    assert float(parts["slope"]) == pytest.approx(0.0, abs=1e-6)
    assert float(parts["change"]) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("adversarial", [0.0, 0.1])
def test_a_resumed_training_equals_an_uninterrupted_one(
    data: Path, tmp_path: Path, adversarial: float
) -> None:
    losses = WrinkleLosses(adversarial=adversarial)
    loop = LoopConfig(steps=4, batch=2, validate_every=2, average=0.9, schedule="constant")
    whole = fit(new_objective(data, losses), tmp_path / "whole", loop, resume=False)
    fit(new_objective(data, losses), tmp_path / "parts", replace(loop, steps=2), resume=False)
    parts = fit(new_objective(data, losses), tmp_path / "parts", loop, resume=True)
    assert whole["unexplained"] == parts["unexplained"]


def test_a_person_in_both_splits_is_refused(data: Path) -> None:
    run = load_run(data / "train" / "clip_a.npz")
    save_run(replace(run, subject="b"), data / "train" / "clip_a.npz")
    with pytest.raises(InputError, match="person b: is in training and validation"):
        new_objective(data)


def test_a_run_of_another_mesh_is_refused(data: Path) -> None:
    path = data / "train" / "clip_a.npz"
    save_run(replace(load_run(path), mesh="other"), path)
    with pytest.raises(InputError, match=r"clip_a\.npz: is not of the fine mesh of tops"):
        new_objective(data)


def test_data_without_validation_are_refused(data: Path) -> None:
    (data / "validation" / "clip_b.npz").unlink()
    with pytest.raises(InputError, match="has no run of the split validation"):
        new_objective(data)


def test_a_mesh_of_another_edge_length_is_refused(data: Path, cloth: Garment) -> None:
    with pytest.raises(InputError, match=r"fine_mesh\.npz: has edges of 30\.0 mm, not 20\.0"):
        fine_mesh(cloth, data, 0.02)
