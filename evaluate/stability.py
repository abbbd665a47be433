"""How far a method that feeds on itself gets from the truth: in one step, in rollouts that start from it."""

import torch
from torch import Tensor

from evaluate.metrics import distance_scores
from uvcloth.bodies.frames import body_frames, with_lead
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.rotations import rotate, rotate_back
from uvcloth.geometry.skinning import carry
from uvcloth.methods.method import Method
from uvcloth.rollout import rollout
from uvcloth.simulate.sequence import Sequence as Simulated

ALONE = 50
"""Frames of a short rollout (Motion-guided, Table 3)."""


def stability_scores(method: Method, outfit: Outfit, simulated: Simulated, end: int) -> dict[str, Tensor]:
    """Mean vertex distances, mm, of a method that heeds what it observes, over settling .. end, (F,) each.

    one_step_mm_raw, one_step_mm: before and after contact, the true garment having been observed after every
    frame before. rollout_50_mm_raw, rollout_50_mm: without contact and after it, in rollouts of ALONE frames
    one behind the other. Each starts anew as the window does: it observes as many true garments as there are
    settling frames, then its own.
    """
    settling = simulated.settling
    stepped = _errors(method, outfit, simulated, 0, end, known=end)

    def rolled(contact: bool) -> Tensor:
        spans = [(first, min(first + settling + ALONE, end)) for first in range(0, end - settling, ALONE)]
        parts = [_errors(method, outfit, simulated, *span, known=settling, contact=contact) for span in spans]
        return torch.cat(parts)[:, int(contact)]

    return {
        "one_step_mm_raw": stepped[:, 0],
        "one_step_mm": stepped[:, 1],
        "rollout_50_mm_raw": rolled(contact=False),
        "rollout_50_mm": rolled(contact=True),
    }


def heeds(method: Method, outfit: Outfit, simulated: Simulated) -> bool:
    """Whether an observed garment changes a method's state; one may remember its own predictions only."""
    if not method.remembers:
        return False
    frames = body_frames(outfit.body, with_lead(simulated.transforms[:1]), simulated.fps)
    state = method.start(outfit, frames)
    return method.observe(state, (simulated.vertices[0],)) is not state


def _errors(
    method: Method,
    outfit: Outfit,
    simulated: Simulated,
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
    return torch.stack(errors[simulated.settling :])


def copied_truth(garment: Garment, simulated: Simulated, end: int) -> dict[str, dict[str, Tensor]]:
    """The errors, mm, (F,) each, of predicting no change since the last true garment that was observed.

    "held": it stays where it was. "carried": it keeps its offsets from the smoothly skinned garment, in the
    axes that this carries along. Of either one_step_mm, rollout_50_mm and vertex_mean_mm; for the last, only
    the garment before the first frame that counts is ever seen (that frame itself where nothing settles).
    There is no contact: each also counts as the error before it (..._raw).
    """
    settling = simulated.settling
    frames = torch.arange(settling, end)
    found: dict[str, dict[str, Tensor]] = {"held": {}, "carried": {}}
    for key, span in {"one_step_mm": 1, "rollout_50_mm": ALONE, "vertex_mean_mm": len(frames)}.items():
        seen = (settling - 1 + (frames - settling) // span * span).clamp(min=0)
        chunks = zip(frames.split(ALONE), seen.split(ALONE), strict=True)
        errors = torch.cat([_copy_errors(garment, simulated, *chunk) for chunk in chunks])
        for kind, values in zip(("held", "carried"), errors.unbind(1), strict=True):
            found[kind] |= {key: values, f"{key}_raw": values}
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
