"""How far a method that feeds on itself gets from the truth: in one step, in rollouts that start from it."""

import torch
from torch import Tensor

from evaluate.metrics import distance_scores
from uvcloth.bodies.frames import body_frames, with_lead
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.rotations import rotate, rotate_back
from uvcloth.geometry.skinning import skin_frames
from uvcloth.methods.method import Method
from uvcloth.rollout import CPU, rollout
from uvcloth.simulate.sequence import SimulatedSequence

SHORT_ROLLOUT = 50
"""Frames of a short rollout (Motion-guided, Table 3)."""


def stability_scores(
    method: Method, outfit: Outfit, simulated: SimulatedSequence, end: int
) -> dict[str, Tensor]:
    """Mean vertex distances, mm, of a method that uses feedback, over warm-up .. end, (F,) each.

    one_step_mm_raw, one_step_mm: before and after contact, the true garment having been observed after every
    frame before. rollout_50_mm_raw, rollout_50_mm: without contact and after it, in rollouts of SHORT_ROLLOUT
    frames one behind the other. Each starts anew as the window does: it observes as many true garments as
    there are warm-up frames, then its own.
    """
    warm_up = simulated.warm_up
    stepped = _errors(method, outfit, simulated, 0, end, known=end)

    def rolled(contact: bool) -> Tensor:
        spans = [
            (first, min(first + warm_up + SHORT_ROLLOUT, end))
            for first in range(0, end - warm_up, SHORT_ROLLOUT)
        ]
        parts = [_errors(method, outfit, simulated, *span, known=warm_up, contact=contact) for span in spans]
        return torch.cat(parts)[:, int(contact)]

    return {
        "one_step_mm_raw": stepped[:, 0],
        "one_step_mm": stepped[:, 1],
        "rollout_50_mm_raw": rolled(contact=False),
        "rollout_50_mm": rolled(contact=True),
    }


def uses_feedback(method: Method, outfit: Outfit, simulated: SimulatedSequence) -> bool:
    """Whether an observed garment changes a method's state; one may remember its own predictions only."""
    if not method.autoregressive:
        return False
    frames = body_frames(outfit.body, with_lead(simulated.transforms[:1]), simulated.fps)
    prepared = method.prepare(outfit, CPU)
    state = method.init(prepared, frames)
    return method.feed_back(prepared, state, (simulated.vertices[:1],)) is not state


def _errors(
    method: Method,
    outfit: Outfit,
    simulated: SimulatedSequence,
    first: int,
    last: int,
    known: int,
    contact: bool = True,
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
            rollout(method, outfit, transforms, simulated.fps, contact, truth=shown), truth, strict=True
        )
    ]
    return torch.stack(errors[simulated.warm_up :])


def copied_truth(garment: Garment, simulated: SimulatedSequence, end: int) -> dict[str, dict[str, Tensor]]:
    """The errors, mm, (F,) each, of predicting no change since the last true garment that was observed.

    "held": it stays where it was. "carried": it keeps its offsets from the smoothly skinned garment, in the
    axes that this carries along. Of either one_step_mm, rollout_50_mm and vertex_mean_mm; for the last, only
    the garment before the first frame that counts is ever seen (that frame itself where nothing settles).
    There is no contact: each also counts as the error before it (..._raw).
    """
    warm_up = simulated.warm_up
    frames = torch.arange(warm_up, end)
    found: dict[str, dict[str, Tensor]] = {"held": {}, "carried": {}}
    for key, span in {
        "one_step_mm": 1,
        "rollout_50_mm": SHORT_ROLLOUT,
        "vertex_mean_mm": len(frames),
    }.items():
        seen = (warm_up - 1 + (frames - warm_up) // span * span).clamp(min=0)
        chunks = zip(frames.split(SHORT_ROLLOUT), seen.split(SHORT_ROLLOUT), strict=True)
        errors = torch.cat([_copy_errors(garment, simulated, *chunk) for chunk in chunks])
        for kind, values in zip(("held", "carried"), errors.unbind(1), strict=True):
            found[kind] |= {key: values, f"{key}_raw": values}
    return found


def _copy_errors(garment: Garment, simulated: SimulatedSequence, frames: Tensor, seen: Tensor) -> Tensor:
    """Errors (F, 2), mm, in `frames` of the garments of the frames `seen`, held and carried."""
    points, weights, transforms = garment.mesh.vertices, garment.smooth_weights, simulated.transforms
    held = simulated.vertices[seen]
    origins, axes = skin_frames(points, weights, transforms[seen])
    offsets = rotate_back(axes, held - origins)
    origins, axes = skin_frames(points, weights, transforms[frames])
    truth = simulated.vertices[frames]
    copies = (held, origins + rotate(axes, offsets))
    return torch.stack([distance_scores(copy, truth)["vertex_mean_mm"] for copy in copies], dim=1)
