"""The comparison on outfits that each have a body of their own, by type of garment."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from functools import partial
from itertools import accumulate, pairwise
from pathlib import Path
from statistics import mean
from typing import Any

from evaluate.actions import Window
from evaluate.candidates import assigned, load_candidates
from evaluate.case import Case, make_case
from evaluate.compare import Selection, garment_size, judged_case, measured
from evaluate.judge import cached, code_fingerprint
from evaluate.progress import progress
from evaluate.show import Shown
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.simulate.outfit_sequence import OutfitSequence, load_outfit_sequences
from uvcloth.simulate.sequence import SimulatedSequence, read_metadata

UNTYPED = "garment"
"""The type of a garment whose data do not say it."""


def holds_outfits(data: Path) -> bool:
    """Test for a folder of outfits on bodies of their own, as `uvcloth simulate --outfits` makes it.

    Raises InputError for a file that is no sequence.
    """
    return any("outfit" in read_metadata(path) for path in sorted(data.glob("*.npz"))[:1])


def compare_outfits(
    models: Sequence[str], selection: Selection, out: Path, *, machine: str
) -> tuple[dict[str, Any], list[Shown]]:
    """Judge methods on the outfits of a folder; a garment is named by its type, so that figures are by type.

    Otherwise as `compare`. No maps are measured. Raises InputError as that does, and for outfits on bodies of
    several skeletons.
    """
    data, split = selection.data, selection.split
    if selection.files:
        raise InputError(f"{data}: contains random outfits, --garment is not allowed")
    found = load_outfit_sequences(data, (split,))
    cases = [
        outfit_case(data, sequence, selection.frames)
        for sequence in found
        if not selection.actions or _action(sequence) in selection.actions
    ]
    if not cases:
        known = ", ".join(dict.fromkeys(map(_action, found)))
        raise InputError(f"{data}: no {split} action is called {selection.actions[0]!r}, expected {known}")
    candidates = load_candidates(models, cases[0].outfit.body)
    dressing = assigned(candidates, {_key(case): case.outfit for case in cases}, data)
    code, judged = code_fingerprint(), []
    with progress("Outfits", sum(1 + len(dressing[_key(case)]) for case in cases)) as tick:
        for case in cases:
            setting = f"{code}/{case.outfit.body.identity.whole}/{machine}"
            keep = partial(cached, out, case)
            judged.append(judged_case(case, dressing[_key(case)], keep, setting, tick))
    people = {sequence.clip: sequence.subject for sequence in found}
    bodies = {case.outfit.body.name for case in cases}
    return {
        **measured(judged, candidates, people),
        "garments": _sizes(cases),
        "missing": {},
        "split": split,
        "map_size": 0,
        "body": f"their own ({len(bodies)})",
        "date": date.today().isoformat(),
        "machine": machine,
        "code": code[:12],
    }, [each.shown for each in judged]


def outfit_case(data: Path, moved: OutfitSequence, frames: int | None = None) -> Case:
    """The case of an outfit in a data folder, its garments named by their types."""
    types = _distinct([kind or UNTYPED for kind in moved.types])
    named = zip(moved.outfit.garments, types, strict=True)
    outfit = Outfit(moved.outfit.body, tuple(replace(garment, name=kind) for garment, kind in named))
    windows, sequences = [], []
    spans = pairwise(accumulate(moved.sizes, initial=0))
    parts = zip(outfit.garments, spans, moved.files.items(), strict=True)
    for garment, (start, end), (file, content) in parts:
        windows.append(Window(_action(moved), moved.clip, moved.subject, garment.name, data / file, None))
        sequences.append(
            SimulatedSequence(
                vertices=moved.vertices[:, start:end],
                faces=garment.mesh.faces,
                rest=garment.mesh.vertices,
                transforms=moved.transforms,
                fps=moved.fps,
                warm_up=moved.warm_up,
                metadata={"clip": moved.clip, "garment": garment.name, "hash": content},
            )
        )
    return make_case(tuple(windows), tuple(sequences), outfit, {}, frames)


def _distinct(names: Sequence[str]) -> list[str]:
    """Names, numbered from the second of a kind on."""
    counts = [names[: index + 1].count(name) for index, name in enumerate(names)]
    return [name if count == 1 else f"{name} {count}" for name, count in zip(names, counts, strict=True)]


def _action(moved: OutfitSequence) -> str:
    return str(moved.metadata.get("action") or moved.clip)


def _key(case: Case) -> str:
    """Name by which cases differ: the files of an outfit over a clip."""
    return "+".join(window.path.stem for window in case.windows)


def _sizes(cases: Sequence[Case]) -> dict[str, dict[str, float | int]]:
    """Mean vertices and size in MB of the garments of each type."""
    by_type: dict[str, list[dict[str, float | int]]] = {}
    for case in cases:
        for garment in case.outfit.garments:
            by_type.setdefault(garment.name, []).append(garment_size(garment))
    return {
        kind: {
            "vertices": round(mean(size["vertices"] for size in sizes)),
            "model_mb": mean(size["model_mb"] for size in sizes),
        }
        for kind, sizes in by_type.items()
    }
