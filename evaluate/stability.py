"""Stability of a method that uses feedback: errors in one step, and in rollouts from the truth."""

from dataclasses import replace
from itertools import islice

import torch
from torch import Tensor

from uvcloth.bodies.frames import body_frames, with_lead
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.garments.garment import Garment
from uvcloth.geometry.rotations import rotate, rotate_back
from uvcloth.geometry.skinning import skin_frames
from uvcloth.methods.capabilities import feed_back
from uvcloth.rollouts.rollout import PreparedRollout

from .case import Case
from .metrics import distance_scores

SHORT_ROLLOUT = 50
"""Frames of a short rollout (Motion-guided, Table 3)."""


def stability_scores(prepared: PreparedRollout, case: Case) -> dict[str, dict[str, Tensor]]:
    """Mean vertex distances, mm, of a method that uses feedback, in the scored frames, (F,) each, by part.

    one_step_mm_raw, one_step_mm: before and after the finish, with the true garments observed after every
    earlier frame. rollout_50_mm_raw, rollout_50_mm: without a finish and after it, in consecutive rollouts of
    SHORT_ROLLOUT frames. Each rollout has a warm-up as long as that of the case, in which it observes the
    true garments; then it observes its own.
    """
    spans = [
        (first, min(first + case.start + SHORT_ROLLOUT, case.end))
        for first in range(0, case.end - case.start, SHORT_ROLLOUT)
    ]
    alone = replace(prepared, clearing=None)
    stepped = _errors(prepared, case, (0, case.end), known=case.end)
    short_raw, short = (
        torch.cat([_errors(rollout, case, span, known=case.start)[:, stage] for span in spans])
        for stage, rollout in enumerate((alone, prepared))
    )
    return {
        part.name: {
            "one_step_mm_raw": stepped[:, 0, index],
            "one_step_mm": stepped[:, 1, index],
            "rollout_50_mm_raw": short_raw[:, index],
            "rollout_50_mm": short[:, index],
        }
        for index, part in enumerate(case.parts)
    }


def uses_feedback(prepared: PreparedRollout, case: Case) -> bool:
    """True if observed garments change a method's state, not its own predictions alone."""
    method = prepared.method
    if not method.traits.autoregressive:
        return False
    frames = body_frames(case.outfit.body, with_lead(case.motion[:1]), case.fps)
    state = method.init(prepared.prepared, frames)
    observed = tuple(garment.vertices[:1] for garment in case.clip.garments)
    return feed_back(method, prepared.prepared, state, observed) is not state


def _errors(prepared: PreparedRollout, case: Case, span: tuple[int, int], known: int) -> Tensor:
    """Errors (F, 2, parts), mm, before and after the finish, over a span of frames, its warm-up left out.

    known: number of frames, from the first on, in which the truth is observed.
    """
    first, last = span
    garments = [garment.vertices[first:last] for garment in case.clip.garments]
    truth = list(zip(*garments, strict=True))
    frames = prepared.frames(case.motion[first:last], case.fps, truth=truth[:known])
    errors = []
    for frame, true in islice(zip(frames, truth, strict=True), case.start, None):
        points = torch.stack([torch.cat(frame.raw), torch.cat(frame.vertices)]).cpu()
        apart = [
            distance_scores(points[:, part.rows], torch.cat(true)[part.rows])["vertex_mean_mm"]
            for part in case.parts
        ]
        errors.append(torch.stack(apart, dim=1))
    return torch.stack(errors)


def copied_truth(garment: Garment, simulated: SimulatedClip, end: int) -> dict[str, dict[str, Tensor]]:
    """The errors, mm, (F,) each, of predicting no change since the last true garment that was observed.

    "held": it stays in place. "carried": it keeps its local offsets from the smoothly skinned garment. Both
    have one_step_mm, rollout_50_mm and vertex_mean_mm; for the last, only the garment before the first scored
    frame is observed (that frame itself without a warm-up). There is no finish: each is also the error
    before it (..._raw).
    """
    warm_up = simulated.warm_up
    frames = torch.arange(warm_up, end)
    errors_of: dict[str, dict[str, Tensor]] = {"held": {}, "carried": {}}
    for key, span in {
        "one_step_mm": 1,
        "rollout_50_mm": SHORT_ROLLOUT,
        "vertex_mean_mm": len(frames),
    }.items():
        sources = (warm_up - 1 + (frames - warm_up) // span * span).clamp(min=0)
        chunks = zip(frames.split(SHORT_ROLLOUT), sources.split(SHORT_ROLLOUT), strict=True)
        errors = torch.cat([_copy_errors(garment, simulated, *chunk) for chunk in chunks])
        for kind, values in zip(("held", "carried"), errors.unbind(1), strict=True):
            errors_of[kind] |= {key: values, f"{key}_raw": values}
    return errors_of


def _copy_errors(garment: Garment, simulated: SimulatedClip, frames: Tensor, sources: Tensor) -> Tensor:
    """Errors (F, 2), mm, in `frames` of copies of the garments in `sources`, (F,) each: held, carried."""
    points, weights, transforms = garment.mesh.vertices, garment.smooth_weights, simulated.transforms
    held = simulated.vertices[sources]
    origins, axes = skin_frames(points, weights, transforms[sources])
    offsets = rotate_back(axes, held - origins)
    origins, axes = skin_frames(points, weights, transforms[frames])
    truth = simulated.vertices[frames]
    copies = (held, origins + rotate(axes, offsets))
    return torch.stack([distance_scores(copy, truth)["vertex_mean_mm"] for copy in copies], dim=1)
