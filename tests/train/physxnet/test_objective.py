"""PhysXNet's losses and validation on garments of two triangles, worked out by hand."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from tests.small_body import small_body
from tests.train.physxnet.two_triangles import CONFIG, PIXELS, SHEET, SIDE, prepared, save_clip
from tests.train.simulated import save_clips
from train.physxnet import objective as module
from train.physxnet.objective import Losses, PhysXNetObjective
from uvcloth.bodies.body import load_body
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.physxnet.config import PRESETS
from uvcloth.methods.physxnet.method import PhysXNet
from uvcloth.rollouts.rollout import rollout

TRUE = torch.tensor([0.0, 0.015625, -0.03125]).expand(4, 3)
"""Offsets of the simulated garment, m, which half precision holds exactly."""

STRETCH = TRUE + (SHEET - SHEET[0]) * torch.tensor([0.1, 0.0, 0.0])
"""The same, drawn out by a tenth along X."""

INDEX = (
    "trial,subject,split,action,window_start,window_frames\n"
    "a,ann,train,,0,8\nb,ann,train,,0,8\nc,bob,validation,,0,8\nd,cid,train,,0,8\n"
)

LOSSES = Losses(l1=2.0, edge=3.0, bend=5.0, mirror=False)


class Constant(nn.Module):
    """A network that predicts the same offsets (templates, 4, 3) for every input."""

    def __init__(self, *offsets: Tensor) -> None:
        super().__init__()
        maps = torch.zeros(3 * len(offsets), 64)
        maps[:, PIXELS] = torch.stack(offsets).transpose(1, 2).flatten(0, 1)
        self.maps = nn.Parameter(maps.view(-1, 8, 8))
        scale = torch.tensor([0.5, 1.0, 0.25]).repeat(len(offsets))
        self.register_buffer("output_scale", scale[:, None, None])

    def forward(self, maps: Tensor) -> Tensor:
        return self.maps.expand(len(maps), -1, -1, -1)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Two clips of both garments and, to train on, one of the tops alone; the last clip validates."""
    for clip in ("a", "c"):
        save_clip(tmp_path / "data", clip, {"tops": TRUE, "dress": TRUE})
    save_clip(tmp_path / "data", "b", {"tops": TRUE})
    return tmp_path / "data"


def objective(
    data: Path, monkeypatch: pytest.MonkeyPatch, losses: Losses = LOSSES, **settings: Any
) -> PhysXNetObjective:
    config = replace(CONFIG, **settings)
    monkeypatch.setattr(module, "prepare", lambda *_: prepared(config.templates))
    return PhysXNetObjective(config, losses, [data], data.parent)


def parts_of(objective: PhysXNetObjective, net: nn.Module, rows: Tensor) -> dict[str, float]:
    ((name, total, parts),) = objective.steps({"net": net}, rows)
    assert name == "net"
    assert total.item() == pytest.approx(sum(part.item() for part in parts.values()), rel=1e-5)
    return {name: part.item() for name, part in parts.items()}


def test_a_perfect_prediction_costs_nothing(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = objective(data, monkeypatch)
    parts = parts_of(made, Constant(TRUE), made.samples[:3])
    assert parts == pytest.approx({"l1": 0.0, "edge": 0.0, "bend": 0.0}, abs=2e-3)


def test_losses_of_a_garment_drawn_out_along_x(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two corners are a tenth of the side off: along two edges of five, and partly along the diagonal."""
    made = objective(data, monkeypatch)
    parts = parts_of(made, Constant(STRETCH), made.samples[:1])
    # Of four corners two are off, in one of three channels, whose scale is a half.
    l1 = 2.0 * (2 * 0.1 * SIDE / 4) / 0.5 / 3
    edge = 3.0 * (2 * 0.1 + (2.21 / 2) ** 0.5 - 1) / 5
    bend = 5.0 * (2 * 0.1 + 0.1 / 2**0.5) / 5
    assert parts == pytest.approx({"l1": l1, "edge": edge, "bend": bend}, rel=3e-3)


def test_a_shift_costs_no_edges_and_no_bends(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = objective(data, monkeypatch)
    shifted = TRUE + torch.tensor([0.0, 0.0, 0.01])
    parts = parts_of(made, Constant(shifted), made.samples[:1])
    assert parts["l1"] == pytest.approx(2.0 * 0.01 / 0.25 / 3, rel=3e-3)
    assert (parts["edge"], parts["bend"]) == pytest.approx((0.0, 0.0), abs=2e-3)


def test_a_garment_that_a_clip_lacks_weighs_nothing_in_it(
    data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Clip a has both, clip b only the tops: of three garments the dress, once, is off."""
    made = objective(data, monkeypatch, templates=("tops", "dress"))
    rows = torch.stack([made.samples[0], made.samples[-1]])
    assert made.frames.present[rows].tolist() == [[True, True], [True, False]]
    parts = parts_of(made, Constant(TRUE, STRETCH), rows)
    assert parts["l1"] == pytest.approx(2.0 * (0.1 * SIDE / 2) / 0.5 / 3 / 3, rel=3e-3)
    # Edges and bends are those of the batch's first row, which has two garments.
    assert parts["edge"] == pytest.approx(3.0 * (0.2 + (2.21 / 2) ** 0.5 - 1) / 5 / 2, rel=3e-3)
    only = parts_of(made, Constant(TRUE, STRETCH), rows[1:])
    assert only == pytest.approx({"l1": 0.0, "edge": 0.0, "bend": 0.0}, abs=2e-3)


def test_a_texel_that_one_body_does_not_see_counts_on_the_other_alone(
    data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first corner of the garment, on a smaller body, is seen by no texel."""
    small = replace(small_body(scale=0.9), name="small")
    save_clip(data.parent / "small", "d", {"tops": TRUE}, body=small)
    (data.parent / "small" / "index.csv").write_text(INDEX)
    (data / "index.csv").write_text(INDEX)
    unseen = {"box": 0, "small": 1}
    monkeypatch.setattr(module, "prepare", lambda run, body, *_: prepared(("tops",), unseen[body.name]))
    made = PhysXNetObjective(CONFIG, LOSSES, [data, data.parent / "small"], data.parent)
    assert made.frames.bodies[made.samples].tolist() == [0] * 10 + [1] * 5
    assert made.data.files.keys() == {
        "data/a_tops.npz",
        "data/b_tops.npz",
        "data/c_tops.npz",
        "small/d_tops.npz",
    }
    wrong = TRUE.clone()
    wrong[0, 1] += 0.1
    box, smaller = (parts_of(made, Constant(wrong), made.samples[[row]])["l1"] for row in (0, -1))
    assert box == pytest.approx(2.0 * 0.1 / 4 / 3, rel=3e-3)
    assert smaller == pytest.approx(0.0, abs=2e-3)
    wrong[3, 1] += 0.1
    (smaller,) = (parts_of(made, Constant(wrong), made.samples[[row]])["l1"] for row in (-1,))
    assert smaller == pytest.approx(2.0 * 0.1 / 3 / 3, rel=3e-3)
    both = parts_of(made, Constant(wrong), made.samples[[0, -1]])["l1"]
    assert both == pytest.approx((2 * 2.0 * 0.1 / 4 / 3 + smaller) / 2, rel=3e-3)
    net: Any = made.networks()["net"]
    torch.testing.assert_close(net.output_shift.flatten(), TRUE[0], atol=2e-5, rtol=0)


def test_statistics_are_mean_and_deviation_of_the_offsets(
    data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_clip(data, "b", {"tops": STRETCH})
    made = objective(data, monkeypatch)
    net: Any = made.networks()["net"]
    rows = made.samples[::4]
    offsets = [STRETCH if made.frames.rows.starts[row] > 0 else TRUE for row in rows]
    values = torch.cat(offsets)
    torch.testing.assert_close(net.output_shift.flatten(), values.mean(0), atol=2e-5, rtol=0)
    expected = values.std(0).clamp(min=1e-6)
    torch.testing.assert_close(net.output_scale.flatten(), expected, atol=2e-5, rtol=0)


def test_validation_is_the_distance_in_millimetres(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tops are ten centimetres off at two corners of four, the dress 3, 4 and 0 mm along the axes."""
    made = objective(data, monkeypatch, templates=("tops", "dress"))
    net = Constant(STRETCH, TRUE + torch.tensor([0.003, 0.004, 0.0]))
    found = made.validate(net)
    assert found == pytest.approx({"mean_mm": 27.5, "tops_mm": 50.0, "dress_mm": 5.0}, abs=0.02)


def test_validation_is_that_of_a_rollout(tmp_path: Path) -> None:
    """Clip 1, on its own, with a network that sees its own predictions."""
    save_clips(tmp_path, ("tops",), clips=3, frames=5, warm_up=2)
    config = replace(PRESETS["tiny"], templates=("tops",))
    body = load_body()
    made = PhysXNetObjective(config, LOSSES, [tmp_path], tmp_path / "run")
    torch.manual_seed(0)
    net: Any = made.networks()["net"].eval()
    truth = load_simulated(tmp_path / "clip1_tops.npz")
    outfit = Outfit(body, (fit_template("tops", body),))
    frames = rollout(PhysXNet(config, net), outfit, truth.transforms, truth.fps, clear=False)
    errors = [
        (frame.raw[0] - vertices).norm(dim=1).mean()
        for frame, vertices in zip(frames, truth.vertices, strict=True)
    ]
    expected = 1000.0 * float(torch.stack(errors[2:]).mean())
    assert expected > 0.5
    assert made.validate(net) == pytest.approx({"mean_mm": expected, "tops_mm": expected}, rel=1e-4)
