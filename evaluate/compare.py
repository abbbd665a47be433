"""The whole comparison: every method on every case, the floors, and the content of metrics.json."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

from evaluate.actions import Window, find_missing, find_windows, people_in
from evaluate.candidates import SIMULATION, Candidate, assigned
from evaluate.case import Case, open_case, outfit_name, simulated_together
from evaluate.familiar import training_overlap
from evaluate.judge import (
    CaseScores,
    Scores,
    cached,
    code_fingerprint,
    judge,
    judge_simulation,
    repeatability,
)
from evaluate.maps import garment_map
from evaluate.progress import progress
from evaluate.results import PartScores, floor, representation_floor, stability, summarize
from evaluate.show import Shown
from evaluate.stability import copied_truth
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.loading import load_garment_for_data
from uvcloth.garments.templates import TEMPLATES, fit_template


@dataclass(frozen=True)
class Selection:
    """The part of a data folder that is judged.

    actions: only these, all if empty. files: garments other than the templates. frames: of each window, None
    for all. split: test, or validation to choose by.
    """

    data: Path
    actions: Sequence[str] = ()
    files: Sequence[str] = ()
    frames: int | None = None
    split: str = "test"


@dataclass(frozen=True)
class JudgedCase:
    """A case after all methods were judged on it.

    scores: by name, the simulation first. contents: hash of each window's sequence. repeated: by garment, the
    errors of its repeat. copied: by kind and garment, those of the frame before. shown: what to look at.
    """

    scores: Mapping[str, CaseScores]
    contents: Mapping[Window, str]
    fps: float
    repeated: Mapping[str, Scores]
    copied: Mapping[str, Mapping[str, Scores]]
    shown: Shown


def compare(
    candidates: Sequence[Candidate],
    selection: Selection,
    out: Path,
    *,
    body: Body,
    map_size: int,
    machine: str,
) -> tuple[dict[str, Any], list[Shown]]:
    """Judge methods on the outfits, most of them of one garment, that were simulated over unseen clips.

    map_size: of the maps that are measured. machine: for the record. Returns the content of metrics.json and
    what there is to look at. Finished cases are kept under OUT/partial and taken over by a rerun. A method is
    judged on the outfits that it supports. Raises InputError for a model or data that does not fit, and for a
    method that supports none of the outfits.
    """
    data, split = selection.data, selection.split
    others = load_garment_files(selection.files, body)
    chosen = (data, selection.actions, (*TEMPLATES, *others), split)
    windows = find_windows(*chosen)
    for name in others:
        if name not in {window.garment for window in windows}:
            raise InputError(f"{data}: holds no {split} sequence of the garment {name} (CLIP_{name}.npz)")
    names = dict.fromkeys(window.garment for window in windows)
    garments = {name: others[name] if name in others else fit_template(name, body) for name in names}
    cases = simulated_together(windows)
    outfits = {_named(case): Outfit(body, tuple(garments[w.garment] for w in case)) for case in cases}
    dressing = assigned(candidates, outfits, data)
    texels = {name: garment_map(garment, body, map_size) for name, garment in garments.items()}
    code = code_fingerprint()
    setting = f"{code}/{body.identity.whole}/{map_size}/{machine}"
    judged = []
    with progress("Windows", sum(1 + len(dressing[_named(case)]) for case in cases)) as tick:
        for case in cases:
            name = _named(case)
            opened = open_case(case, outfits[name], texels, selection.frames)
            judged.append(judged_case(opened, dressing[name], partial(cached, out, opened), setting, tick))
    return {
        **measured(judged, candidates, people_in(data)),
        "garments": {name: garment_size(garment) for name, garment in garments.items()},
        "missing": find_missing(*chosen),
        "split": split,
        "map_size": map_size,
        "body": body.name,
        "date": date.today().isoformat(),
        "machine": machine,
        "code": code[:12],
    }, [each.shown for each in judged]


def judged_case(
    case: Case,
    candidates: Sequence[Candidate],
    keep: Callable[[str, str, Callable[[], CaseScores]], CaseScores],
    setting: str,
    tick: Callable[..., None],
) -> JudgedCase:
    """Judge methods on a case. keep: takes over what is finished, by name and setting, or works it out."""
    note = f"{case.action}, {_named(case.windows)}"
    tick(0, note=note)
    scores = {SIMULATION: keep(SIMULATION, setting, partial(judge_simulation, case))}
    simulated = list(zip(case.windows, case.outfit.garments, case.sequences, strict=True))
    repeated = {garment.name: repeatability(window, sequence) for window, garment, sequence in simulated}
    copied = {garment.name: copied_truth(garment, sequence, case.end) for _, garment, sequence in simulated}
    tick()
    for candidate in candidates:
        tick(0, note=f"{note}: {candidate.name}")
        fingerprint = f"{setting}/{candidate.fingerprint}"
        scores[candidate.name] = keep(candidate.name, fingerprint, partial(judge, case, candidate))
        tick()
    return JudgedCase(
        scores=scores,
        contents={window: str(sequence.metadata.get("hash")) for window, _, sequence in simulated},
        fps=case.fps,
        repeated=repeated,
        copied={kind: {name: by[kind] for name, by in copied.items()} for kind in ("held", "carried")},
        shown=Shown(
            action=case.action,
            clip=case.windows[0].clip,
            outfit=case.outfit,
            fps=case.fps / case.stride,
            stride=case.stride,
            transforms=case.transforms[:: case.stride],
            meshes={name: found.shown for name, found in scores.items()},
        ),
    )


def measured(
    judged: Sequence[JudgedCase], candidates: Sequence[Candidate], people: Mapping[str, str]
) -> dict[str, Any]:
    """The fields of metrics.json on the methods and the simulation. people: subjects by clip."""
    names = (SIMULATION, *(candidate.name for candidate in candidates))
    entries = {
        name: [
            PartScores(case.shown.action, part, scores)
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
        for c in candidates
    }
    repeats = by_garment([case.repeated for case in judged])
    copies = {kind: by_garment([case.copied[kind] for case in judged]) for kind in ("held", "carried")}
    windows = [window for case in judged for window in case.contents]
    frames = [len(e.scores["vertex_mean_mm"]) for e in entries[SIMULATION] if e.part not in outfits]
    return {
        **results,
        "methods": methods,
        "floor": {**representation_floor(methods), **floor(repeats, "repeatability")},
        "previous_frame": {
            kind: {garment: stability(found) for garment, found in by.items()} for kind, by in copies.items()
        },
        "outfits": {name: {"garments": list(garments)} for name, garments in outfits.items()},
        "actions": list(dict.fromkeys(window.action for window in windows)),
        "windows": len(windows),
        "frames": sum(frames),
        "fps": frame_rate(judged),
    }


def frame_rate(judged: Sequence[JudgedCase]) -> float:
    """Frames per second of the cases; where they differ, that of most of them."""
    return Counter(case.fps for case in judged).most_common(1)[0][0]


def facts(candidate: Candidate, judged_on: Mapping[Window, str], people: Mapping[str, str]) -> dict[str, Any]:
    """The fields of metrics.json on a method besides its scores. judged_on: windows and their hashes."""
    return {
        "weights_mb": candidate.weights_mb,
        **training_overlap(candidate, judged_on, people),
        "static": candidate.method.quasi_static,
        "baseline": candidate.method.is_baseline,
        "training_frames": candidate.training_frames,
        "training": dict(candidate.training),
    }


def by_garment(cases: Sequence[Mapping[str, Scores]]) -> dict[str, list[Scores]]:
    """The scores of several cases by garment."""
    garments = dict.fromkeys(garment for case in cases for garment in case)
    return {garment: [case[garment] for case in cases if garment in case] for garment in garments}


def load_garment_files(files: Sequence[str], body: Body) -> dict[str, Garment]:
    """Garments from files by the names that their sequences have; what is a template is not among them.

    Raises InputError also if two have one name.
    """
    garments: dict[str, Garment] = {}
    for file in files:
        garment = load_garment_for_data(file, body, print)
        if garment.name in garments:
            raise InputError(f"garment {file}: another one is also named {garment.name}")
        garments[garment.name] = garment
    return {name: garment for name, garment in garments.items() if name not in TEMPLATES}


def _named(windows: Sequence[Window]) -> str:
    """The outfit of windows that were simulated together."""
    return outfit_name([window.garment for window in windows])


def garment_size(garment: Garment) -> dict[str, float | int]:
    """Vertices of a garment and the size of its 3D model in MB (positions, faces and texture coordinates)."""
    mesh = garment.mesh
    tensors = (mesh.vertices.float(), mesh.faces.int(), mesh.uvs.float(), mesh.face_uvs.int())
    return {
        "vertices": len(mesh.vertices),
        "model_mb": sum(tensor.nbytes for tensor in tensors) / 1e6,
    }
