"""Judging: roll methods out over cases and score every frame."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import torch
from torch import Tensor

from uvcloth.bodies.frames import LEAD, body_frames, with_lead
from uvcloth.methods.capabilities import round_trip
from uvcloth.rollouts.rollout import PreparedRollout, prepare_rollout

from .body_scores import body_scores
from .candidates import Candidate
from .case import Case, ScoredPart
from .continuity import continuity_scores
from .looks import look_scores
from .metrics import (
    distance_scores,
    energy_scores,
    layer_scores,
    map_mse,
    shape_scores,
    spread_scores,
    swing_scores,
)
from .stability import stability_scores, uses_feedback

MEMBER_SUFFIX = "_member"
"""Suffix of the scores of another simulation."""

REPRESENTED = "representation_"
"""Prefix of the scores of a method's own representation."""

ENCODED_AT_ONCE = 16
"""Frames that are written in a method's representation at the same time: bounds the memory of large maps."""

Scores = Mapping[str, Tensor]
"""By measure, F values (swing F - 1, jitter F - 2), fewer of measures that are sampled."""


@dataclass(frozen=True)
class CaseScores:
    """One method on one case.

    parts: scores per frame of each garment and, if there are several, of the whole outfit, by name. The last
    part also has the times of a method, "network_ms" and "contact_ms", and of several garments the vertices
    on the wrong side. A method that uses feedback also has scores of stability, and a method with a
    representation those of it.
    shown: (S, N, 3) every stride-th frame of the whole outfit after the finish, metres, world.
    """

    parts: Mapping[str, Scores]
    shown: Tensor


def judge(
    case: Case,
    candidate: Candidate,
    live: bool = True,
    others: Sequence[Candidate] = (),
    spent_ms: float | None = None,
) -> CaseScores:
    """Roll a method out from the first warm-up frame and score the scored frames.

    live: False for a recording, which has no turned scene, and times only if it is known how many
    milliseconds a frame it took, spent_ms. others: rollouts of the same method that differ by chance, for an
    energy score.

    A method that uses feedback, or has parts that only do what a finish does, is rolled out again without
    it for the scores before the finish, which otherwise would depend on it. One that uses feedback is
    also rolled out from the truth. Raises InputError if a prediction is not a finite number.
    """
    prepared = prepare_rollout(candidate.method, case.outfit)
    raw, resolved, times = rolled_out(case, prepared)
    more = representation(case, prepared)
    feeds_back = uses_feedback(prepared, case)
    if prepared.method is not candidate.method:
        raw, _, _ = rolled_out(case, prepare_rollout(candidate.method, case.outfit, clear=False))
    elif feeds_back:
        raw, _, _ = rolled_out(case, replace(prepared, clearing=None))
    if feeds_back:
        stable = stability_scores(prepared, case)
        more = {name: {**scores, **more.get(name, {})} for name, scores in stable.items()}
    scored = score(case, raw, resolved)
    rollouts = [resolved, *(rolled_out(case, prepare_rollout(c.method, case.outfit))[1] for c in others)]
    parts = {
        part.name: {
            **scored.parts[part.name],
            **more.get(part.name, {}),
            **energy_scores([rollout[:, part.rows] for rollout in rollouts], part.reference),
        }
        for part in case.parts
    }
    if live and case.turned:
        turned = continuity_scores(case, prepared, resolved)
        parts = {name: {**scores, **turned[name]} for name, scores in parts.items()}
    if live or spent_ms is not None:
        parts[case.parts[-1].name] |= {**times, "network_ms": times["network_ms"] + (spent_ms or 0.0)}
    return CaseScores(parts, scored.shown)


def rolled_out(case: Case, prepared: PreparedRollout) -> tuple[Tensor, Tensor, Scores]:
    """All vertices (F, N, 3) of a rollout in the scored frames, predicted and finished, and its times.

    They are the processor's for this process, whatever else the machine does.
    """
    raw, resolved, milliseconds = [], [], []
    timed = replace(prepared, clock=time.process_time)
    for frame in islice(timed.frames(case.motion, case.fps), case.start, None):
        raw.append(torch.cat(frame.raw).cpu())
        resolved.append(torch.cat(frame.vertices).cpu())
        milliseconds.append([frame.milliseconds["network"], frame.milliseconds["clearing"]])
    network, clearing = torch.tensor(milliseconds).unbind(1)
    return torch.stack(raw), torch.stack(resolved), {"network_ms": network, "contact_ms": clearing}


def judge_simulation(case: Case) -> CaseScores:
    """The simulation scored as if it were a prediction: no error, but its own edges, bends and jitter.

    With an ensemble, its member on the same mesh is scored by its looks (..._member): as good as possible.
    """
    scored = score(case, case.truth, case.truth)
    parts = {part.name: {**scored.parts[part.name], **_member_scores(case, part)} for part in case.parts}
    return replace(scored, parts=parts)


def _member_scores(case: Case, part: ScoredPart) -> Scores:
    """Looks of the first other member of an ensemble; nothing without one."""
    others = part.reference.members[:1]
    return {
        f"{key}{MEMBER_SUFFIX}": values
        for other in others
        for key, values in {**swing_scores(other, part.reference), **_look_scores(case, part, other)}.items()
    }


def score(case: Case, raw: Tensor, resolved: Tensor) -> CaseScores:
    """Score all garments as predicted (F, N, 3) and finished (F, N, 3) on the scored frames."""
    before = _frame_scores(case, raw)
    after = before if torch.equal(raw, resolved) else _frame_scores(case, resolved)
    parts = {
        part.name: {
            **map_mse(raw[:, part.rows], part.reference),
            **spread_scores(part.reference),
            **{f"{key}_raw": values for key, values in before[part.name].items()},
            **after[part.name],
        }
        for part in case.parts
    }
    return CaseScores(parts, resolved[:: case.stride])


def _frame_scores(case: Case, frames: Tensor) -> dict[str, dict[str, Tensor]]:
    """Scores of each part of an outfit (F, N, 3), per frame; the whole has those of the layers."""
    parts = {}
    for part in case.parts:
        vertices = frames[:, part.rows]
        parts[part.name] = {
            **shape_scores(vertices, part.reference),
            **body_scores(case.dressed[part.name], vertices, case.body_vertices),
            **_look_scores(case, part, vertices),
        }
    *garments, whole = case.parts
    layers = {part.name: frames[:, part.rows] for part in garments}
    parts[whole.name] |= layer_scores(layers, {part.name: part.reference.faces for part in garments})
    return parts


def _look_scores(case: Case, part: ScoredPart, vertices: Tensor) -> Scores:
    """Measures of motion and looks of a part (F, N, 3)."""
    dressed = case.dressed[part.name]
    return look_scores(case.looks[part.name], vertices, part.reference, dressed, case.body_vertices)


@torch.no_grad()
def representation(case: Case, prepared: PreparedRollout) -> dict[str, Scores]:
    """Errors, mm and mm2, and swing of the simulation written in a representation and read back, by part.

    Empty for a method without a representation of its own.
    """
    chunks = []
    led = with_lead(case.motion)
    for first in range(case.start, case.end, ENCODED_AT_ONCE):
        last = min(first + ENCODED_AT_ONCE, case.end)
        frames = body_frames(case.outfit.body, led[first : last + LEAD], case.fps)
        truth = tuple(garment.vertices[first:last] for garment in case.clip.garments)
        read = round_trip(prepared.method, prepared.prepared, frames, truth)
        if read is None:
            return {}
        chunks.append(torch.cat(read, dim=1))
    shown = torch.cat(chunks)
    return {
        part.name: {
            f"{REPRESENTED}{key}": values
            for key, values in {
                **distance_scores(shown[:, part.rows], part.reference.vertices),
                **swing_scores(shown[:, part.rows], part.reference),
            }.items()
        }
        for part in case.parts
    }
