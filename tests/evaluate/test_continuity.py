"""A method that does not look at the compass passes, one that does is off by what it adds."""

from dataclasses import dataclass
from typing import Any

import pytest
import torch
from torch import Tensor

from evaluate.actions import Window
from evaluate.case import make_case
from evaluate.continuity import TURNED_FRAMES, continuity_scores
from tests.evaluate.test_compare import LBS, capsule_body, simulated, tube_garment
from uvcloth.bodies.frames import BodyFrames
from uvcloth.garments.garment import Outfit
from uvcloth.methods.method import Method
from uvcloth.rollouts.rollout import prepare_rollout


@dataclass(frozen=True)
class Northward(Method):
    """The skinned garment, moved along the world's X axis."""

    metres: float
    name: str = "northward"

    def prepare(self, outfit: Outfit, device: torch.device) -> Any:
        return LBS.prepare(outfit, device)

    def step(self, prepared: Any, state: Any, frames: BodyFrames) -> tuple[Any, tuple[Tensor, ...]]:
        state, garments = LBS.step(prepared, state, frames)
        return state, tuple(vertices + torch.tensor([self.metres, 0.0, 0.0]) for vertices in garments)


@pytest.mark.parametrize("metres", [0.0, 0.003])
def test_a_turned_scene_gives_the_turned_garment(metres: float) -> None:
    garment = tube_garment("tops")
    window = Window("a", "02_04", "", "tops", None)  # type: ignore[arg-type]
    clip = simulated(garment, "02_04", torch.zeros(3))
    case = make_case((window,), clip, Outfit(capsule_body(), (garment,)), {})
    prepared = prepare_rollout(Northward(metres), case.outfit)
    moved = torch.stack([torch.cat(frame.vertices) for frame in prepared.frames(case.motion, case.fps)])
    scores = continuity_scores(case, prepared, moved[case.start :])["tops"]
    assert scores["turned_mm"].tolist() == pytest.approx([1000 * 2**0.5 * metres] * TURNED_FRAMES, abs=1e-3)
    assert scores["turned_max_mm"].tolist() == pytest.approx(scores["turned_mm"].tolist(), abs=1e-3)
