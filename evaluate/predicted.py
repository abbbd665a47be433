"""Sequences of other programs, judged by the same measures as methods: a file for every judged sequence."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch

from uvcloth.dataset.folder import MEMBERS, member_folder
from uvcloth.dataset.predicted_file import READERS, find_file, read_milliseconds, read_prediction
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.methods.method import Method, Traits

from .actions import Window
from .candidates import FINISHED, SIMULATION, Candidate, finished
from .case import Case
from .judge import CaseScores, judge
from .recorded import Recorded

NAMED = "="
"""Separator between the name and the folder of a prediction."""


@dataclass(frozen=True)
class Prediction:
    """The sequences of another program in the comparison.

    name: in every table. folder: of its files, each with the name of the sequence that it predicts and
    another suffix. finishes: suffixes of the name, as those of models. The others are the fields of a
    `Candidate`; nothing is known of a training.
    """

    name: str
    folder: Path
    fingerprint: str
    finishes: tuple[str, ...] = ()
    weights_mb: float = 0.0
    training_content: frozenset[str] = frozenset()
    training_frames: int | None = None
    clips: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    training: Mapping[str, float] = field(default_factory=dict)
    traits: Traits = field(default_factory=Traits)

    def rollouts(self, windows: Sequence[Window]) -> list[Path]:
        """The folder, and those of its members that have files of some windows."""
        members = [member_folder(self.folder, member) for member in range(1, MEMBERS)]
        return [
            self.folder,
            *(each for each in members if all(find_file(each, w.path.stem) for w in windows)),
        ]

    def finished(self, method: Method) -> Method:
        """A method with the finish. Raises InputError for one that is not known."""
        for suffix in self.finishes:
            method = finished(method, suffix, f"--predicted {self.name}")
        return method

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The reason that the finish cannot move an outfit."""
        return self.finished(Recorded(self.name, torch.zeros(0), ())).unsupported_reason(outfit)


def load_predictions(options: Sequence[str], taken: Iterable[str]) -> tuple[Prediction, ...]:
    """Find the folders of `--predicted NAME=DIR` and their finishes, as in `NAME=DIR@dynamic`.

    taken: names of the methods. Raises InputError for another form, no such folder, another finish, or a name
    that occurs twice.
    """
    predictions: list[Prediction] = []
    names = {SIMULATION, *taken}
    for option in options:
        label = f"--predicted {option}"
        plain, sign, place = option.partition(NAMED)
        if not (plain and sign and place):
            raise InputError(f"{label}: expected NAME{NAMED}DIR")
        # A folder may have the sign in its name.
        folder, *finishes = [place] if Path(place).is_dir() else place.split(FINISHED)
        name = FINISHED.join([plain, *finishes])
        if name in names:
            raise InputError(f"{label}: another method is called {name!r}")
        if not Path(folder).is_dir():
            raise InputError(f"{label}: no such folder")
        names.add(name)
        content = fingerprint(_fingerprint(Path(folder)), *finishes)
        prediction = Prediction(name, Path(folder), content, tuple(finishes))
        prediction.finished(Recorded(name, torch.zeros(0), ()))
        predictions.append(prediction)
    return tuple(predictions)


def covered(
    predictions: Sequence[Prediction],
    outfits: Mapping[str, Outfit],
    windows: Iterable[tuple[str, Sequence[Window]]],
) -> dict[str, list[Prediction]]:
    """The predictions that have files of each outfit, and a finish that can move it.

    windows: the name of the outfit and the windows of each case. Raises InputError for a prediction without
    any file, for one that lacks windows of an outfit, and for one whose finish cannot move any of them.
    """
    cases = list(windows)
    covering: dict[str, list[Prediction]] = {name: [] for name in outfits}
    for prediction in predictions:
        names = {
            name
            for name, together in cases
            if any(find_file(prediction.folder, window.path.stem) for window in together)
        }
        for window in (w for name, together in cases if name in names or not names for w in together):
            if find_file(prediction.folder, window.path.stem) is None:
                raise InputError(
                    f"{prediction.folder}: lacks the sequence {window.path.stem} ({', '.join(READERS)})"
                )
        reasons = {name: prediction.unsupported_reason(outfits[name]) for name in names}
        if all(reasons.values()):
            raise InputError(f"--predicted {prediction.name}: {'; '.join(dict.fromkeys(reasons.values()))}")
        for name in names:
            if not reasons[name]:
                covering[name].append(prediction)
    return covering


def judge_prediction(case: Case, prediction: Prediction) -> CaseScores:
    """Score the sequences of another program in the scored frames, as they are and after the finish.

    Other rollouts of it, in the folder of each member as in data, give an energy score. It has times if all
    files say theirs. Raises InputError naming the file that does not fit the simulation, see
    `read_prediction`.
    """
    files = [find_file(prediction.folder, window.path.stem) for window in case.windows]
    times = [read_milliseconds(path) for path in files if path]
    spent = None if None in times else sum(time for time in times if time is not None)
    first, *others = [played(case, prediction, folder) for folder in prediction.rollouts(case.windows)]
    return judge(case, first, live=False, others=others, spent_ms=spent)


def played(case: Case, prediction: Prediction, folder: Path) -> Candidate:
    """The sequences of a folder as a method."""
    garments = []
    for window, simulated in zip(case.windows, case.clip.garments, strict=True):
        path = find_file(folder, window.path.stem)
        assert path is not None
        garments.append(read_prediction(path, simulated, case.clip.fps))
    method = prediction.finished(Recorded.of(prediction.name, case.clip.transforms, garments))
    return Candidate(prediction.name, method, 0.0, prediction.fingerprint, frozenset())


def _fingerprint(folder: Path) -> str:
    """Hash of names, sizes and times of all files of a folder: kept scores of others are not reused."""
    files = [(str(path.relative_to(folder)), path.stat()) for path in sorted(folder.rglob("*"))]
    return fingerprint(*(f"{name}/{stat.st_size}/{stat.st_mtime_ns}" for name, stat in files))
