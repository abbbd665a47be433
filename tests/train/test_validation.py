"""Scores of rollouts of a box in a sheet, worked out by hand."""

from dataclasses import dataclass

import pytest
import torch

from tests.dataset.altered import altered
from tests.small_body import small_body
from train.validation import ROLLOUT_FRAMES, mean_errors, rollout_distances
from uvcloth.dataset.clip import SimulatedClip, SimulatedGarment
from uvcloth.geometry.skinning import skin
from uvcloth.methods.method import Method

CPU = torch.device("cpu")
BODY = small_body()
SHEET = torch.tensor([[0.0, 0.0, 0.1], [0.1, 0.0, 0.1], [0.0, 0.1, 0.1], [0.1, 0.1, 0.1]])


@dataclass(frozen=True)
class Drifting(Method):
    """Carries two garments with the chest, the second a hundredth of a metre a second too far back."""

    name: str = "drifting"

    def step(self, prepared, state, frames):  # type: ignore[no-untyped-def]
        seconds = (state or 0) / frames.fps
        moved = skin(SHEET, torch.tensor([0.0, 1.0]).expand(4, 2), frames.transforms[:, -1])
        back = torch.tensor([0.0, 0.01 * seconds, 0.0])
        return (state or 0) + 1, (moved, moved + back)


def clip_of(
    name: str, frames: int, garments: tuple[str, ...], fps: float = 10.0, warm_up: int = 2
) -> SimulatedClip:
    """A walk along X, and garments that lie where the first of `Drifting` does."""
    transforms = torch.eye(3, 4).repeat(frames, 2, 1, 1)
    transforms[:, :, 0, 3] = torch.arange(frames)[:, None] / fps
    vertices = SHEET + transforms[:, 1, None, :, 3]
    worn = tuple(SimulatedGarment(garment, vertices, torch.zeros(0, 3), SHEET) for garment in garments)
    return SimulatedClip(worn, transforms, fps, warm_up, {"clip": name})


def errors(*clips: SimulatedClip) -> dict[str, float]:
    return mean_errors(rollout_distances(Drifting(), None, BODY, ("vest", "coat"), clips, CPU))


def test_scores_are_means_over_the_scored_frames_of_each_garment() -> None:
    """The coat is 1 mm off after each tenth of a second: frames 2, 3 and 4 count."""
    found = errors(clip_of("a", 5, ("vest", "coat")))
    assert found == pytest.approx({"mean_mm": 1.5, "vest_mm": 0.0, "coat_mm": 3.0}, abs=1e-3)
    assert next(iter(found)) == "mean_mm"  # By the first one a network is chosen.


def test_a_garment_that_a_clip_lacks_is_not_scored_in_it() -> None:
    alone = clip_of("b", 5, ("vest",))
    aside = torch.tensor([0.004, 0.0, 0.0])
    moved = altered(alone, vertices=alone.vertices + aside)
    found = errors(clip_of("a", 5, ("vest", "coat")), moved)
    assert found == pytest.approx({"mean_mm": 2.5, "vest_mm": 2.0, "coat_mm": 3.0}, abs=1e-3)
    assert set(errors(moved)) == {"mean_mm", "vest_mm"}


def test_each_frame_rate_is_rolled_out_by_itself() -> None:
    """At 20 frames a second the coat is half as far off in frames 2 and 3: six frames of two clips in all."""
    found = errors(clip_of("a", 5, ("coat",)), clip_of("b", 5, ("coat",), fps=20.0))
    assert found["coat_mm"] == pytest.approx((2 + 3 + 4 + 1 + 1.5 + 2) / 6, abs=1e-3)


def test_long_clips_are_scored_over_their_beginning() -> None:
    found = errors(clip_of("a", ROLLOUT_FRAMES + 9, ("coat",)))
    assert found["coat_mm"] == pytest.approx(2 + (ROLLOUT_FRAMES - 1) / 2, rel=1e-4)
