"""Errors of methods that feed on themselves, where they are known in advance."""

from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from torch import Tensor

import evaluate.stability as measured
from evaluate.actions import Window
from evaluate.case import make_case
from evaluate.results import stability
from evaluate.stability import copied_truth, stability_scores
from tests.dataset.altered import altered
from tests.evaluate.test_compare import COUNTED, FPS, SETTLING, capsule_body, motion, simulated, tube_garment
from uvcloth.bodies.frames import BodyFrames
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.skinning import skin
from uvcloth.methods.capabilities import Feedback
from uvcloth.methods.method import Method, Traits
from uvcloth.rollouts.rollout import prepare_rollout

STRAY = 0.001
END = SETTLING + COUNTED


@dataclass(frozen=True)
class Straying(Method, Feedback):
    """Carries its garment along with the body's only joint, and a millimetre upwards in every frame."""

    name: str = "straying"
    traits = Traits(autoregressive=True)

    def prepare(self, outfit: Outfit, device: torch.device) -> Garment:
        return outfit.garments[0]

    def init(self, prepared: Garment, frames: BodyFrames) -> Tensor:
        return skin(prepared.mesh.vertices, prepared.weights, frames.transforms[:, 0])

    def step(self, prepared: Garment, state: Tensor, frames: BodyFrames) -> tuple[Tensor, tuple[Tensor, ...]]:
        moved = frames.transforms[0, -1, 0, :, 3] - frames.transforms[0, -2, 0, :, 3]
        state = state + moved + torch.tensor([0.0, 0.0, STRAY])
        return state, (state,)

    def feed_back(self, prepared: Garment, state: Tensor, garments: tuple[Tensor, ...]) -> Tensor:
        return garments[0]

    def displaced(self, prepared: Garment, state: Tensor, shift: Tensor) -> Tensor:
        return state + shift[:, None]


@pytest.fixture
def window() -> SimulatedClip:
    """A garment that stays 5 cm above its rest shape: far enough that clearing leaves it alone."""
    return simulated(tube_garment("tops"), "02_04", torch.tensor([0.0, 0.0, 0.05]))


def test_errors_grow_with_the_frames_since_the_truth(
    window: SimulatedClip, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measured, "SHORT_ROLLOUT", 5)
    outfit = Outfit(capsule_body(), (tube_garment("tops"),))
    where = Window("jump", "02_04", "", "tops", Path())
    case = make_case((where,), window, outfit, {})
    scores = stability_scores(prepare_rollout(Straying(), outfit), case)["tops"]
    assert scores["one_step_mm"].tolist() == pytest.approx([1.0] * COUNTED, abs=0.05)
    assert scores["one_step_mm_raw"].tolist() == pytest.approx([1.0] * COUNTED, abs=1e-3)
    assert scores["rollout_50_mm"].tolist() == pytest.approx([1, 2, 3, 4, 5] * 2 + [1, 2], abs=0.1)
    assert scores["rollout_50_mm_raw"].tolist() == pytest.approx([1, 2, 3, 4, 5] * 2 + [1, 2], abs=1e-3)


def test_copies_of_the_truth_miss_what_has_moved_since(
    window: SimulatedClip, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measured, "SHORT_ROLLOUT", 5)
    copies = copied_truth(tube_garment("tops"), window, END)
    path = 1000.0 * motion(END)[:, 0, :, 3]
    for key, seen in (("one_step_mm", 1), ("rollout_50_mm", 5), ("vertex_mean_mm", COUNTED)):
        last = [SETTLING - 1 + k // seen * seen for k in range(COUNTED)]
        moved = (path[SETTLING:] - path[last]).norm(dim=1)
        torch.testing.assert_close(copies["held"][key], moved, atol=1e-2, rtol=0)
        assert copies["carried"][key].max() < 1e-2


def test_carried_copies_turn_with_the_body(window: SimulatedClip) -> None:
    garment = tube_garment("tops")
    turns = torch.arange(END) / FPS
    rotation = torch.stack([turns.cos(), -turns.sin(), turns.sin(), turns.cos()], dim=-1).view(END, 2, 2)
    transforms = torch.eye(3, 4).repeat(END, 1, 1, 1)
    transforms[:, 0, :2, :2] = rotation
    beside = garment.mesh.vertices + torch.tensor([0.03, 0.0, 0.0])
    turned = altered(window, transforms=transforms, vertices=skin(beside, garment.weights, transforms))
    copies = copied_truth(garment, turned, END)
    assert copies["carried"]["one_step_mm"].max() < 1e-2
    assert copies["held"]["one_step_mm"].min() > 1.0


def test_drift_compares_the_end_of_long_windows_with_their_beginning() -> None:
    def scores(frames: int) -> dict[str, Tensor]:
        errors = torch.full((frames,), 10.0)
        errors[50:150], errors[-100:] = 20.0, 30.0
        return {"vertex_mean_mm": errors, "vertex_mean_mm_raw": errors + 1.0}

    both = stability([scores(300), scores(200)])
    assert both["late_over_early"] == pytest.approx(1.5)
    assert both["frames"] == 500
    alone = stability([{"vertex_mean_mm": torch.full((100,), 99.0), "one_step_mm": torch.full((100,), 2.0)}])
    assert alone["late_over_early"] is None
    assert alone["one_step_mm_raw"] is None
    assert (alone["one_step_mm"], alone["rollout_50_mm"], alone["whole_mm"]) == (2.0, 99.0, 99.0)
