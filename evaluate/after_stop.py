"""After a stop: the energy of cloth that swings out while the body stands.

Cloth swings for a second after a walk has stopped; cloth that follows the skeleton alone freezes.
"""

import torch
from torch import Tensor

from .metrics import Reference

STANDING_SPEED = 0.02
"""Speed of the skinned garment, m/s, below which the body stands."""

LEAST_SECONDS = 0.5
"""Seconds that a body stands at the end of a window that counts as a stop."""

FIRST_SECONDS = 0.2
"""Seconds after a stop whose mean energy of the simulation is the measure of settled cloth."""

SETTLED_SHARE = 0.1
"""Share of that energy below which cloth has settled."""


def stop_scores(vertices: Tensor, reference: Reference) -> dict[str, Tensor]:
    """Energy of (F, N, 3) after the stop at the end of a window; nothing if it has none.

    stop_energy: (T,) mean kinetic energy per mass relative to the skinned garment, mJ/kg, between the frames
    in which the body stands. settle_s: (1,) seconds until it stays below SETTLED_SHARE of the simulation's
    energy in the first FIRST_SECONDS; all the seconds of the stop if it does not.
    """
    fps = reference.fps
    first = _stands_from(reference.skinned, fps)
    if len(vertices) - 1 - first < LEAST_SECONDS * fps:
        return {}
    energy, truth = (
        500.0 * ((each - reference.skinned)[first:].diff(dim=0) * fps).square().sum(2).mean(1)
        for each in (vertices, reference.vertices)
    )
    lively = energy >= SETTLED_SHARE * truth[: max(1, round(FIRST_SECONDS * fps))].mean()
    settled = int(torch.nonzero(lively).max()) + 1 if lively.any() else 0
    return {"stop_energy": energy, "settle_s": torch.tensor([settled / fps])}


def _stands_from(skinned: Tensor, fps: float) -> int:
    """First frame from which a skinned garment (F, N, 3) no longer moves; the last one if it does."""
    moves = skinned.diff(dim=0).norm(dim=2).amax(1) * fps >= STANDING_SPEED
    return int(torch.nonzero(moves).max()) + 1 if moves.any() else 0
