"""Overlap of training and test: sequences, motions and people that a model saw and is judged on."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from .actions import Window
from .candidates import Candidate
from .predicted import Prediction

Entrant = Candidate | Prediction
"""A method in the comparison, or the sequences of another program."""

MADE_BY = {"train": "was trained on", "validation": "was selected on"}
"""The use of each split of a model's own data, in words; the more serious one first."""


@dataclass(frozen=True)
class Familiar:
    """The overlap of a window with the data that a model was trained or selected on.

    split: "train" or "validation", the split of those data. same: "sequence" if they hold the window's
    simulation itself, "clip" if they hold its motion (with another garment or simulation, or poses of it),
    "person" if they hold other motion of its subject. subject: that person, "" if unknown. clips: the clips
    of the model's data that overlap.
    """

    split: str
    same: str
    subject: str
    clips: tuple[str, ...]


@dataclass(frozen=True)
class Caution:
    """A warning on a method: the number of windows that overlap with its data, and the sources in words.

    says: "was trained on" or "was selected on". red: the overlap makes the scores misleading.
    """

    method: str
    says: str
    windows: int
    familiar: tuple[str, ...]
    red: bool


def familiarity(
    window: Window, content: str, candidate: Entrant, people: Mapping[str, str]
) -> Familiar | None:
    """The most serious overlap of a window with a method's own data; None if none is known.

    content: hash of the window's sequence. people: subjects, by clip, for models that do not name them.
    """
    known = content in candidate.training_content
    if known and not any(window.clip in clips for clips in candidate.clips.values()):
        return Familiar("train", "sequence", window.subject, ())
    for split in MADE_BY:
        clips = candidate.clips.get(split, {})
        if window.clip in clips:
            return Familiar(split, "sequence" if known else "clip", window.subject, (window.clip,))
        theirs = [clip for clip, subject in clips.items() if window.subject == (subject or people.get(clip))]
        if window.subject and theirs:
            return Familiar(split, "person", window.subject, tuple(theirs))
    return None


def training_overlap(
    candidate: Entrant, windows: Mapping[Window, str], people: Mapping[str, str]
) -> dict[str, Any]:
    """The fields of metrics.json on the overlap of a method's data with the judged windows.

    windows: the hash of each window's sequence. people: subjects by clip.
    """
    met = {w.name: familiarity(w, content, candidate, people) for w, content in windows.items()}
    familiar = {window: asdict(overlap) for window, overlap in met.items() if overlap is not None}
    return {
        "trained_on": [window for window, overlap in familiar.items() if overlap["split"] == "train"],
        "chosen_on": [window for window, overlap in familiar.items() if overlap["split"] == "validation"],
        "familiar": familiar,
    }


def cautions(results: Mapping[str, Any]) -> list[Caution]:
    """The warnings on the methods in metrics.json whose own data overlaps with the judged windows.

    An evaluation of validation windows is expected to overlap with the validation data: no red warning.
    """
    warnings = []
    for name, method in results["methods"].items():
        for split, says in MADE_BY.items():
            met = {window: f for window, f in method["familiar"].items() if f["split"] == split}
            if met:
                red = split == "train" or results["split"] != split
                warnings.append(Caution(name, says, len(met), _named(met), red))
    return warnings


def _named(met: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    """Familiar windows by the source of their overlap, in words."""
    groups: dict[str, list[str]] = {}
    for window, familiar in met.items():
        source = _source(familiar["same"], familiar["subject"], familiar["clips"])
        groups.setdefault(source, []).append(window)
    return tuple(f"{source} (window{'s' * (len(w) > 1)} {', '.join(w)})" for source, w in groups.items())


def _source(same: str, subject: str, clips: Sequence[str]) -> str:
    """The source of an overlap in words."""
    if same == "person":
        return f"person {subject} in clip{'s' * (len(clips) > 1)} {', '.join(clips)}"
    return "this very simulation" if same == "sequence" else f"clip {clips[0]}"
