"""Overlap of training and test: sequences, motions and people that a model saw and is judged on."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from evaluate.actions import Window
from evaluate.candidates import Candidate

MADE_BY = {"train": "was trained on", "validation": "was chosen by"}
"""The role of each split of a model's own data, the graver first."""


@dataclass(frozen=True)
class Familiar:
    """The overlap of a window with the data that a model was made from.

    split: "train" if it was trained on it, "validation" if it was chosen by it. same: "sequence" if it was
    the simulation itself, "clip" if it was the motion (another garment or simulation, or poses of it),
    "person" if it was other motion of the subject. subject: that person, "" if unknown. clips:
    those of the model that are meant.
    """

    split: str
    same: str
    subject: str
    clips: tuple[str, ...]


@dataclass(frozen=True)
class Caution:
    """A warning on a method: the number of windows it has seen, and from what. red: its scores mislead."""

    method: str
    says: str
    windows: int
    familiar: tuple[str, ...]
    red: bool


def familiarity(
    window: Window, content: str, candidate: Candidate, people: Mapping[str, str]
) -> Familiar | None:
    """The gravest overlap of a window with a method's own data; None if none is known.

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
    candidate: Candidate, windows: Mapping[Window, str], people: Mapping[str, str]
) -> dict[str, Any]:
    """The fields of metrics.json on the overlap of a method's data with judged windows, given by hash."""
    met = {w.name: familiarity(w, content, candidate, people) for w, content in windows.items()}
    familiar = {window: asdict(overlap) for window, overlap in met.items() if overlap is not None}
    return {
        "trained_on": [window for window, overlap in familiar.items() if overlap["split"] == "train"],
        "chosen_on": [window for window, overlap in familiar.items() if overlap["split"] == "validation"],
        "familiar": familiar,
    }


def cautions(results: Mapping[str, Any]) -> list[Caution]:
    """The warnings on the methods in metrics.json whose own data overlaps with the judged windows.

    Windows that are judged to choose by (results["split"] validation) are expected to be familiar.
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
    """Familiar windows by what they are known from, in words."""
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
