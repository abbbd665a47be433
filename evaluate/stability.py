"""How far a method that feeds on itself gets from the truth: in one step, in rollouts that start from it."""

import torch
from torch import Tensor

from evaluate.metrics import distance_scores
from uvcloth.bodies.frames import body_frames, with_lead
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.methods.correspondence import carry, rotate, rotate_back
from uvcloth.methods.method import Method
from uvcloth.rollout import rollout
from uvcloth.simulate.sequence import Sequence as Simulated

ALONE = 50
"""Frames of a short rollout (Motion-guided, Table 3)."""


def stability_scores(method: Method, outfit: Outfit, simulated: Simulated, end: int) -> dict[str, Tensor]:
    """Mean vertex distances, mm, of a method that remembers, over the frames settling .. end, (F,) each.

    one_step_mm_raw, one_step_mm: before and after contact, the true garment having been observed after every
    frame before. rollout_50_mm: after contact, in rollouts of ALONE frames one behind the other. Each starts
    anew as the window does: it observes as many true garments as there are settling frames, then its own.
    Empty if the method takes no notice of what it observes.
    """
    if not _heeds(method, outfit, simulated):
        return {}
    settling = simulated.settling
    stepped = _errors(method, outfit, simulated, 0, end, known=end)
    rolled = [
        _errors(method, outfit, simulated, first, min(first + settling + ALONE, end), known=settling)
        for first in range(0, end - settling, ALONE)
    ]
    return {
        "one_step_mm_raw": stepped[:, 0],
        "one_step_mm": stepped[:, 1],
        "rollout_50_mm": torch.cat(rolled)[:, 1],
    }


def _heeds(method: Method, outfit: Outfit, simulated: Simulated) -> bool:
    """Whether an observed garment changes a method's state; one may remember its own predictions only."""
    frames = body_frames(outfit.body, with_lead(simulated.transforms[:1]), simulated.fps)
    state = method.start(outfit, frames)
    return method.observe(state, (simulated.vertices[0],)) is not state


def _errors(
    method: Method, outfit: Outfit, simulated: Simulated, first: int, last: int, known: int
) -> Tensor:
    """Errors (F, 2), mm, before and after contact, over frames first .. last without as many as settle.

    known: of how many frames, from `first` on, the truth is observed.
    """
    truth = simulated.vertices[first:last]
    transforms = simulated.transforms[first:last]
    shown = [(vertices,) for vertices in truth[:known]]
    errors = [
        distance_scores(torch.stack([frame.raw[0], frame.vertices[0]]).cpu(), vertices)["vertex_mean_mm"]
        for frame, vertices in zip(
            rollout(method, outfit, transforms, simulated.fps, truth=shown), truth, strict=True
        )
    ]
    return torch.stack(errors[simulated.settling :])


def copied_truth(garment: Garment, simulated: Simulated, end: int) -> dict[str, dict[str, Tensor]]:
    """The errors, mm, (F,) each, of predicting no change since the last true garment that was observed.

    "held": it stays where it was. "carried": it keeps its offsets from the smoothly skinned garment, in the
    axes that this carries along. Of either one_step_mm, rollout_50_mm and vertex_mean_mm; for the last, only
    the garment before the first frame that counts is ever seen (that frame itself where nothing settles).
    """
    settling = simulated.settling
    frames = torch.arange(settling, end)
    found: dict[str, dict[str, Tensor]] = {"held": {}, "carried": {}}
    for key, span in {"one_step_mm": 1, "rollout_50_mm": ALONE, "vertex_mean_mm": len(frames)}.items():
        seen = (settling - 1 + (frames - settling) // span * span).clamp(min=0)
        chunks = zip(frames.split(ALONE), seen.split(ALONE), strict=True)
        errors = torch.cat([_copy_errors(garment, simulated, *chunk) for chunk in chunks])
        found["held"][key], found["carried"][key] = errors.unbind(1)
    return found


def _copy_errors(garment: Garment, simulated: Simulated, frames: Tensor, seen: Tensor) -> Tensor:
    """Errors (F, 2), mm, in `frames` of the garments of the frames `seen`, held and carried."""
    points, weights, transforms = garment.mesh.vertices, garment.carrier_weights, simulated.transforms
    held = simulated.vertices[seen]
    origins, axes = carry(points, weights, transforms[seen])
    offsets = rotate_back(axes, held - origins)
    origins, axes = carry(points, weights, transforms[frames])
    truth = simulated.vertices[frames]
    copies = (held, origins + rotate(axes, offsets))
    return torch.stack([distance_scores(copy, truth)["vertex_mean_mm"] for copy in copies], dim=1)
