"""Sequences of other programs, judged by the same measures as methods: a file for every judged sequence."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch

from uvcloth.errors import InputError
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.methods.method import Traits
from uvcloth.physics.outfit_clearing import OutfitClearing

from .actions import Window
from .candidates import SIMULATION
from .case import Case
from .judge import CaseScores, score
from .predicted_file import READERS, read_prediction

NAMED = "="
"""Separator between the name and the folder of a prediction."""


@dataclass(frozen=True)
class Prediction:
    """The sequences of another program in the comparison.

    name: in every table. folder: of its files, each with the name of the sequence that it predicts and
    another suffix. The others are the fields of a `Candidate`; nothing is known of a training.
    """

    name: str
    folder: Path
    fingerprint: str
    weights_mb: float = 0.0
    training_content: frozenset[str] = frozenset()
    training_frames: int | None = None
    clips: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    training: Mapping[str, float] = field(default_factory=dict)
    traits: Traits = field(default_factory=Traits)

    def find(self, window: Window) -> Path | None:
        """The file of a window, None without one. Raises InputError if there are two."""
        paths = [self.folder / f"{window.path.stem}{suffix}" for suffix in READERS]
        there = [path for path in paths if path.is_file()]
        if len(there) > 1:
            raise InputError(
                f"{there[0]}: {there[1].name} beside it is of the same sequence, keep one of them"
            )
        return there[0] if there else None

    def covers(self, windows: Iterable[Window]) -> bool:
        """True if there are files of all windows."""
        return all(self.find(window) for window in windows)


def load_predictions(options: Sequence[str], taken: Iterable[str]) -> tuple[Prediction, ...]:
    """Find the folders of `--predicted NAME=DIR`.

    taken: names of the methods. Raises InputError for another form, no such folder, or a name that occurs
    twice.
    """
    predictions: list[Prediction] = []
    names = {SIMULATION, *taken}
    for option in options:
        name, sign, folder = option.partition(NAMED)
        if not (name and sign and folder):
            raise InputError(f"--predicted {option}: expected NAME{NAMED}DIR")
        if name in names:
            raise InputError(f"--predicted {option}: another method is called {name!r}")
        if not Path(folder).is_dir():
            raise InputError(f"--predicted {option}: no such folder")
        names.add(name)
        predictions.append(Prediction(name, Path(folder), _fingerprint(Path(folder))))
    return tuple(predictions)


def require_files(predictions: Sequence[Prediction], outfits: Iterable[tuple[str, Sequence[Window]]]) -> None:
    """Raise InputError for a prediction without any file, and for one that lacks windows of an outfit.

    outfits: the name of the outfit and the windows of each case.
    """
    cases = list(outfits)
    for prediction in predictions:
        names = {name for name, windows in cases if any(map(prediction.find, windows))}
        for window in (window for name, windows in cases if name in names or not names for window in windows):
            if prediction.find(window) is None:
                raise InputError(
                    f"{prediction.folder}: lacks the sequence {window.path.stem} ({', '.join(READERS)})"
                )


def judge_prediction(case: Case, prediction: Prediction) -> CaseScores:
    """Score the sequences of another program in the scored frames, as they are and cleared.

    Raises InputError naming the file that does not fit the simulation, see `read_prediction`.
    """
    garments = []
    for window, simulated in zip(case.windows, case.clip.garments, strict=True):
        path = prediction.find(window)
        assert path is not None
        points = read_prediction(path, simulated, case.clip.fps)
        garments.append(points[case.start : case.end])
    clearing = OutfitClearing.of(case.outfit.body, [garment.mesh for garment in case.outfit.garments])
    cleared = [
        torch.cat(clearing.cleared(frame, body))
        for *frame, body in zip(*garments, case.body_vertices, strict=True)
    ]
    return score(case, torch.cat(garments, dim=1), torch.stack(cleared))


def _fingerprint(folder: Path) -> str:
    """Hash of names, sizes and times of the files of a folder: kept scores of others are not reused."""
    files = [(path.name, path.stat()) for path in sorted(folder.iterdir())]
    return fingerprint(*(f"{name}/{stat.st_size}/{stat.st_mtime_ns}" for name, stat in files))
