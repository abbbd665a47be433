"""The whole comparison: every method on every window, the floors, and the content of metrics.json."""

from collections.abc import Mapping, Sequence
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from evaluate.actions import Window, find_missing, find_windows, people_in
from evaluate.familiar import acquaintance
from evaluate.judge import (
    SIMULATION,
    Candidate,
    Case,
    body_fingerprint,
    cached,
    code_fingerprint,
    judge,
    judge_simulation,
    open_case,
    repeatability,
)
from evaluate.maps import GarmentMap, garment_map, round_trip
from evaluate.metrics import distance_scores
from evaluate.progress import progress
from evaluate.results import Entry, Scores, floor, stability, summarize
from evaluate.show import Shown
from evaluate.stability import copied_truth
from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.loading import load_garment_for_data
from uvcloth.garments.templates import TEMPLATES, fit_template

CHUNK = 16
"""Frames that are written to maps at the same time: bounds the memory of large maps."""


def compare(
    candidates: Sequence[Candidate],
    data: Path,
    out: Path,
    *,
    body: Body,
    actions: Sequence[str],
    files: Sequence[str] = (),
    frames: int | None,
    map_size: int,
    machine: str,
    split: str = "test",
) -> tuple[dict[str, Any], list[Shown]]:
    """Judge methods on the windows of a split of a data folder: test, or validation to choose by.

    files: garments other than the templates. frames: of each window, None for all. map_size: of the maps
    that are measured. machine: for the record. Returns the content of metrics.json and what there is to look
    at. Finished windows are kept under OUT/partial and taken over by a rerun. A method is judged on the
    garments that it dresses. Raises InputError for a model or data that does not fit, and for a method that
    dresses none of the garments.
    """
    others = taken(files, body)
    names = (*TEMPLATES, *others)
    windows = find_windows(data, actions, names, split)
    missing = find_missing(data, actions, names, split)
    for name in others:
        if name not in {window.garment for window in windows}:
            raise InputError(f"{data}: holds no {split} sequence of the garment {name} (CLIP_{name}.npz)")
    code = code_fingerprint()
    setting = f"{code}/{body_fingerprint(body)}/{map_size}/{machine}"
    worn = dict.fromkeys(window.garment for window in windows)
    garments = {name: others[name] if name in others else fit_template(name, body) for name in worn}
    dressing = assigned(candidates, garments, body, data)
    maps = {name: garment_map(garment, body, map_size) for name, garment in garments.items()}

    entries: dict[str, list[Entry]] = {name: [] for name in (SIMULATION, *(c.name for c in candidates))}
    represented: dict[str, list[Scores]] = {name: [] for name in garments}
    repeated: dict[str, list[Scores]] = {name: [] for name in garments}
    copied: dict[str, dict[str, list[Scores]]] = {
        kind: {name: [] for name in garments} for kind in ("held", "carried")
    }
    shown: list[Shown] = []
    contents: dict[Window, str] = {}
    with progress("Windows", sum(1 + len(dressing[window.garment]) for window in windows)) as tick:
        for window in windows:
            seen = maps[window.garment]
            texels = (seen.template.corners, seen.template.barycentrics) if seen else None
            case = open_case(window, body, garments[window.garment], texels, frames)
            tick(0, note=f"{window.action}, {window.garment}")
            contents[window] = str(case.sequence.metadata.get("hash"))
            keep = partial(cached, out, case)
            judged = {SIMULATION: keep(SIMULATION, setting, partial(judge_simulation, case))}
            represented[window.garment].append(representation(case, seen) if seen else {})
            repeated[window.garment].append(repeatability(case))
            end = case.start + len(case.reference.vertices)
            for kind, scores in copied_truth(garments[window.garment], case.sequence, end).items():
                copied[kind][window.garment].append(scores)
            tick()
            for candidate in dressing[window.garment]:
                tick(0, note=f"{window.action}, {window.garment}: {candidate.name}")
                fingerprint = f"{setting}/{candidate.fingerprint}"
                judged[candidate.name] = keep(candidate.name, fingerprint, partial(judge, case, candidate))
                tick()
            for name, found in judged.items():
                entries[name].append(Entry(window.action, window.garment, found))
            shown.append(
                Shown(
                    action=window.action,
                    clip=window.clip,
                    garment=garments[window.garment],
                    fps=case.sequence.fps / case.stride,
                    stride=case.stride,
                    transforms=case.transforms[:: case.stride],
                    meshes={name: found.shown for name, found in judged.items()},
                )
            )

    results = summarize(entries)
    for candidate in candidates:
        results["methods"][candidate.name]["weights_mb"] = candidate.weights_mb
        worn_by = {w: content for w, content in contents.items() if candidate in dressing[w.garment]}
        results["methods"][candidate.name] |= acquaintance(candidate, worn_by, people_in(data))
        results["methods"][candidate.name]["static"] = candidate.method.quasi_static
        results["methods"][candidate.name]["training_frames"] = candidate.training_frames
        results["methods"][candidate.name]["training"] = dict(candidate.training)
    results["floor"] = {**floor(represented, "representation"), **floor(repeated, "repeatability")}
    results["previous_frame"] = {
        kind: {garment: stability(windows) for garment, windows in by_garment.items()}
        for kind, by_garment in copied.items()
    }
    results["garments"] = {name: _size(garment) for name, garment in garments.items()}
    return results | {
        "actions": list(dict.fromkeys(window.action for window in windows)),
        "split": split,
        "windows": len(windows),
        "missing": missing,
        "frames": sum(len(e.judged.scores["vertex_mean_mm"]) for e in entries[SIMULATION]),
        "fps": case.sequence.fps,
        "map_size": map_size,
        "body": body.name,
        "date": date.today().isoformat(),
        "machine": machine,
        "code": code[:12],
    }, shown


def representation(case: Case, seen: GarmentMap) -> dict[str, Tensor]:
    """The representation floor: how far the simulation's decoded maps are from it, per frame."""
    truth = case.reference.vertices
    spans = [slice(first, first + CHUNK) for first in range(0, len(truth), CHUNK)]
    chunks = [round_trip(seen, truth[s], case.body_vertices[s], case.transforms[s]) for s in spans]
    return distance_scores(torch.cat(chunks), truth)


def taken(files: Sequence[str], body: Body) -> dict[str, Garment]:
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


def assigned(
    candidates: Sequence[Candidate], garments: Mapping[str, Garment], body: Body, data: Path
) -> dict[str, tuple[Candidate, ...]]:
    """By garment, those that dress it. Raises InputError naming one that dresses none, and why not."""
    outfits = {name: Outfit(body, (garment,)) for name, garment in garments.items()}
    unsupported = {
        c.name: {name: c.method.unsupported_reason(outfit) for name, outfit in outfits.items()}
        for c in candidates
    }
    for name, heard in unsupported.items():
        if all(heard.values()):
            raise InputError(f"{data}: nothing to judge {name} on: {'; '.join(heard.values())}")
    return {name: tuple(c for c in candidates if not unsupported[c.name][name]) for name in garments}


def _size(garment: Garment) -> dict[str, float | int]:
    """Vertices of a garment and the size of its 3D model in MB (positions, faces and texture coordinates)."""
    mesh = garment.mesh
    tensors = (mesh.vertices.float(), mesh.faces.int(), mesh.uvs.float(), mesh.face_uvs.int())
    return {
        "vertices": len(mesh.vertices),
        "model_mb": sum(tensor.nbytes for tensor in tensors) / 1e6,
    }
