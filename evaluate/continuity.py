"""Continuity: a scene that is turned about the vertical gives the same garment, turned."""

from itertools import islice

import torch
from torch import Tensor

from uvcloth.rollouts.rollout import PreparedRollout

from .case import Case
from .metrics import MM

TURNED_FRAMES = 10
"""Most scored frames of a window that are compared: all the warm-up before them is rolled out again."""

QUARTER = torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Rotation by 90 degrees about the vertical: no floating-point number changes but for its sign."""


def continuity_scores(
    case: Case, prepared: PreparedRollout, resolved: Tensor
) -> dict[str, dict[str, Tensor]]:
    """Distances of a rollout of the turned motion from the turned rollout (F, N, 3), mm, by part.

    turned_mm, turned_max_mm: (S,) mean and largest over vertices in the first TURNED_FRAMES scored frames.
    """
    turned = QUARTER @ case.motion[: case.start + TURNED_FRAMES]
    frames = islice(prepared.frames(turned, case.fps), case.start, None)
    again = torch.stack([torch.cat(frame.vertices).cpu() for frame in frames])
    apart = turned_apart(again, resolved[: len(again)])
    return {
        part.name: {
            "turned_mm": apart[:, part.rows].mean(1),
            "turned_max_mm": apart[:, part.rows].amax(1),
        }
        for part in case.parts
    }


def turned_apart(again: Tensor, frames: Tensor) -> Tensor:
    """Distances (F, N), mm, of a rollout of the turned scene from the turned rollout, (F, N, 3) m both."""
    return (again - frames @ QUARTER.T).norm(dim=2) * MM
