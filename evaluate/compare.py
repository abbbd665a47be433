"""The whole comparison: every method on every case, the floors, and the content of metrics.json."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from statistics import mean
from typing import Any

from uvcloth.garments.garment import Outfit

from .actions import Window
from .candidates import SIMULATION, Candidate, assigned
from .case import Case, outfit_name
from .familiar import Entrant, training_overlap
from .judge import CaseScores, Scores
from .predicted import Prediction, covered
from .progress import progress
from .records import Records
from .results import PartScores, repeatability_floor, representation_floor, stability, summarize
from .selection import Cases, Opener
from .show import Shown
from .stability import copied_truth


@dataclass(frozen=True)
class JudgedCase:
    """A case after all methods were judged on it.

    scores: by name, the simulation first. contents: hash of each window's sequence. copied: by kind and
    garment, the errors of copies of an earlier frame. shown: for the viewer and the pictures.
    """

    scores: Mapping[str, CaseScores]
    contents: Mapping[Window, str]
    fps: float
    copied: Mapping[str, Mapping[str, Scores]]
    shown: Shown


def compare(
    candidates: Sequence[Candidate],
    cases: Cases,
    records: Records,
    predictions: Sequence[Prediction] = (),
) -> tuple[dict[str, Any], list[Shown]]:
    """Judge methods on the outfits, most of them of one garment, that were simulated over unseen clips.

    predictions: sequences of other programs, judged beside the methods. Returns the content of metrics.json
    and the meshes to show. A method is judged on the outfits that it supports. Raises InputError for a model,
    data or a prediction that does not fit, and for a method that supports none of the outfits.
    """
    entrants = entrants_of(candidates, predictions, cases)
    judged = []
    with progress("Cases", sum(1 + len(each) for _, each in entrants)) as tick:
        for opener, judged_on_it in entrants:
            judged.append(judged_case(opener.load(), judged_on_it, records, tick))
    return {
        **measured(judged, [*candidates, *predictions], cases.people),
        "garments": garment_sizes(cases.outfits.values()),
        "missing": cases.missing,
        "split": cases.split,
        "map_size": cases.map_size,
        "body": cases.body_name,
        "date": date.today().isoformat(),
        "machine": records.machine,
        "code": records.code[:12],
    }, [each.shown for each in judged]


def entrants_of(
    candidates: Sequence[Candidate], predictions: Sequence[Prediction], cases: Cases
) -> list[tuple[Opener, list[Entrant]]]:
    """The methods and predictions that can be judged on each case. Raises InputError as `compare` does."""
    dressing = assigned(candidates, cases.outfits, cases.data)
    windows = [(opener.outfit, opener.windows) for opener in cases.openers]
    covering = covered(predictions, cases.outfits, windows)
    return [(opener, [*dressing[opener.outfit], *covering[opener.outfit]]) for opener in cases.openers]


def judged_case(
    case: Case, entrants: Sequence[Entrant], records: Records, tick: Callable[..., None]
) -> JudgedCase:
    """Judge methods on a case, or take what is kept of them."""
    note = f"{case.action}, {outfit_name([window.garment for window in case.windows])}"
    tick(0, note=note)
    scores = {SIMULATION: records.scores(case, None)}
    garments = {garment.name: garment for garment in case.outfit.garments}
    alone = {name: case.clip.alone(name) for name in garments}
    copied = {name: copied_truth(garment, alone[name], case.end) for name, garment in garments.items()}
    tick()
    for each in entrants:
        tick(0, note=f"{note}: {each.name}")
        scores[each.name] = records.scores(case, each)
        tick()
    return JudgedCase(
        scores=scores,
        contents={
            window: str(case.clip.by_name[window.garment].metadata.get("hash")) for window in case.windows
        },
        fps=case.fps,
        copied={kind: {name: by[kind] for name, by in copied.items()} for kind in ("held", "carried")},
        shown=Shown(
            action=case.action,
            clip=case.windows[0].clip,
            outfit=case.outfit,
            fps=case.fps / case.stride,
            stride=case.stride,
            transforms=case.transforms[:: case.stride],
            meshes={name: each.shown for name, each in scores.items()},
        ),
    )


def measured(
    judged: Sequence[JudgedCase], entrants: Sequence[Entrant], people: Mapping[str, str]
) -> dict[str, Any]:
    """The fields of metrics.json on the methods and the simulation. people: subjects by clip."""
    names = (SIMULATION, *(entrant.name for entrant in entrants))
    entries = {
        name: [
            PartScores(case.shown.action, part, scores, case.shown.clip)
            for case in judged
            if name in case.scores
            for part, scores in case.scores[name].parts.items()
        ]
        for name in names
    }
    outfits = {
        outfit_name(garments): garments
        for garments in (tuple(window.garment for window in case.contents) for case in judged)
        if len(garments) > 1
    }
    results = summarize(entries, outfits)
    methods = {
        c.name: results["methods"][c.name]
        | facts(
            c, {w: h for case in judged if c.name in case.scores for w, h in case.contents.items()}, people
        )
        for c in entrants
    }
    copies = {kind: by_garment([case.copied[kind] for case in judged]) for kind in ("held", "carried")}
    windows = [window for case in judged for window in case.contents]
    single = [entry for entry in entries[SIMULATION] if entry.part not in outfits]
    return {
        **results,
        "methods": methods,
        "floor": {**representation_floor(methods), **repeatability_floor(single)},
        "previous_frame": {
            kind: {garment: stability(copy_scores) for garment, copy_scores in by.items()}
            for kind, by in copies.items()
        },
        "outfits": {name: {"garments": list(garments)} for name, garments in outfits.items()},
        "actions": list(dict.fromkeys(window.action for window in windows)),
        "windows": len(windows),
        "people": sorted({window.subject for window in windows if window.subject}),
        "frames": sum(len(entry.scores["vertex_mean_mm"]) for entry in single),
        "fps": frame_rate(judged),
    }


def frame_rate(judged: Sequence[JudgedCase]) -> float:
    """Frames per second of the cases; where they differ, that of most of them."""
    return Counter(case.fps for case in judged).most_common(1)[0][0]


def facts(entrant: Entrant, judged_on: Mapping[Window, str], people: Mapping[str, str]) -> dict[str, Any]:
    """The fields of metrics.json on a method besides its scores. judged_on: windows and their hashes."""
    return {
        "weights_mb": entrant.weights_mb,
        **training_overlap(entrant, judged_on, people),
        "static": entrant.traits.quasi_static,
        "baseline": entrant.traits.is_baseline,
        "training_frames": entrant.training_frames,
        "training": dict(entrant.training),
    }


def by_garment(cases: Sequence[Mapping[str, Scores]]) -> dict[str, list[Scores]]:
    """The scores of several cases by garment."""
    garments = dict.fromkeys(garment for case in cases for garment in case)
    return {garment: [case[garment] for case in cases if garment in case] for garment in garments}


def garment_sizes(outfits: Iterable[Outfit]) -> dict[str, dict[str, float | int]]:
    """Mean number of vertices and mean size of the 3D model, MB (with UV coordinates), by garment name."""
    sizes: dict[str, list[tuple[int, float]]] = {}
    for garment in (garment for outfit in outfits for garment in outfit.garments):
        mesh = garment.mesh
        tensors = (mesh.vertices.float(), mesh.faces.int(), mesh.uvs.float(), mesh.face_uvs.int())
        size = sum(tensor.nbytes for tensor in tensors) / 1e6
        sizes.setdefault(garment.name, []).append((len(mesh.vertices), size))
    return {
        name: {
            "vertices": round(mean(vertices for vertices, _ in each)),
            "model_mb": mean(size for _, size in each),
        }
        for name, each in sizes.items()
    }
