"""Judging: roll methods out over cases and score every frame; finished cases are kept for a rerun."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

import rasterize
import uvcloth
from uvcloth.bodies.frames import LEAD, body_frames, with_lead
from uvcloth.dataset.clip import content_hash
from uvcloth.garments.garment import Garment
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.kept import keep_arrays, kept_arrays
from uvcloth.methods.capabilities import round_trip
from uvcloth.rollout import PreparedRollout, prepare_rollout

from .body_scores import body_scores
from .candidates import Candidate
from .case import Case, Part
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

SCORES_FORMAT = "uvcloth-judged-10"

MEMBER_SUFFIX = "_member"
"""Suffix of the scores of another simulation."""

REPRESENTED = "representation_"
"""Prefix of the scores of a method's own representation."""

ENCODED_AT_ONCE = 16
"""Frames that are written in a method's representation at the same time: bounds the memory of large maps."""

JUDGING = (
    "metrics.py",
    "surface.py",
    "swing_bands.py",
    "wrinkles.py",
    "hem.py",
    "after_stop.py",
    "force_balance.py",
    "continuity.py",
    "looks.py",
    "maps.py",
    "body_scores.py",
    "pixels.py",
    "stability.py",
    "case.py",
    "selection.py",
    "judge.py",
    "predicted.py",
    "predicted_file.py",
    "recorded.py",
)
"""The sources in this folder that decide a score, besides those of rasterize and uvcloth."""

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
            **energy_scores([each[:, part.rows] for each in rollouts], part.reference),
        }
        for part in case.parts
    }
    if live:
        turned = continuity_scores(case, prepared, resolved)
        parts = {name: {**scores, **turned[name]} for name, scores in parts.items()}
    if live or spent_ms is not None:
        parts[case.parts[-1].name] |= {**times, "network_ms": times["network_ms"] + (spent_ms or 0.0)}
    return CaseScores(parts, scored.shown)


def rolled_out(case: Case, prepared: PreparedRollout) -> tuple[Tensor, Tensor, Scores]:
    """All vertices (F, N, 3) of a rollout in the scored frames, predicted and finished, and its times."""
    raw, resolved, milliseconds = [], [], []
    for frame in islice(prepared.frames(case.motion, case.fps), case.start, None):
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


def _member_scores(case: Case, part: Part) -> Scores:
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


def _look_scores(case: Case, part: Part, vertices: Tensor) -> Scores:
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


def cached(out: Path, case: Case, name: str, setting: str, work: Callable[[], CaseScores]) -> CaseScores:
    """The result of an earlier run of the same code on the same input, or that of `work`, then kept."""
    garments = [garment_fingerprint(garment) for garment in case.outfit.garments]
    contents = [
        content_hash(garment, clip.transforms)
        for clip in (case.clip, *case.members)
        for garment in clip.garments
    ]
    text = "/".join([SCORES_FORMAT, setting, *garments, *contents, str(len(case.transforms))])
    key = fingerprint(text)[:16]
    path = Path(out) / "partial" / f"{case.name}_{name}_{key}.npz"
    truth = case.truth[:: case.stride]
    if path.is_file():
        data = kept_arrays(path, SCORES_FORMAT, "a judged window")
        parts = {
            part.name: {
                name.removeprefix(_prefix(index)): torch.from_numpy(values)
                for name, values in data.items()
                if name.startswith(_prefix(index))
            }
            for index, part in enumerate(case.parts)
        }
        return CaseScores(parts, truth + torch.from_numpy(data["offset"].astype(np.float32)))
    judged = work()
    # Offsets from the simulation are small, so half precision keeps them well within a millimetre.
    offset = (judged.shown - truth).half()
    arrays = {"offset": offset.numpy()}
    for index, scores in enumerate(judged.parts.values()):
        arrays |= {f"{_prefix(index)}{key}": values.numpy() for key, values in scores.items()}
    keep_arrays(path, SCORES_FORMAT, arrays)
    # A rerun, which reads the file, is to give the same report.
    return CaseScores(judged.parts, truth + offset.float())


def _prefix(part: int) -> str:
    """The prefix of the names of a part's scores in a file."""
    return f"part{part}/"


def code_fingerprint() -> str:
    """Hash of the sources and data that decide a score: kept results of other code are not reused."""
    contents: list[str | bytes] = []
    for package in (rasterize, uvcloth):
        folder = Path(package.__file__).parent
        for path in sorted([*folder.rglob("*.py"), *folder.rglob("*.npz")]):
            contents += [path.relative_to(folder.parent).as_posix(), path.read_bytes()]
    # In a checkout this folder lies beside the packages, once installed inside one of them.
    for path in (Path(__file__).with_name(name) for name in JUDGING):
        contents += [path.name, path.read_bytes()]
    return fingerprint(*contents)


def garment_fingerprint(garment: Garment) -> str:
    """Hash of the garment that a method sees: its file may change while the sequence stays the same."""
    mesh = garment.mesh
    tensors = (mesh.vertices, mesh.faces, mesh.uvs, mesh.face_uvs, garment.weights, garment.smooth_weights)
    return fingerprint(f"{garment.source}/{garment.template}", *tensors)
