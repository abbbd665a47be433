"""Records: the scores of judged cases, kept for a rerun of the same code on the same input."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch

import rasterize
import uvcloth
from uvcloth.dataset.clip import content_hash
from uvcloth.garments.garment import Garment
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.kept import keep_arrays, kept_arrays

from .candidates import SIMULATION
from .case import Case
from .familiar import Entrant
from .judge import CaseScores, judge, judge_simulation
from .predicted import Prediction, judge_prediction

SCORES_FORMAT = "uvcloth-judged-10"

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
    "recorded.py",
    "records.py",
)
"""The sources in this folder that decide a score, besides those of rasterize and uvcloth."""

DECIDING = ("*.py", "*.npz", "libuvcloth*")
"""Files of rasterize and uvcloth that decide a score: sources, data, and the compiled runtime."""


@dataclass(frozen=True)
class Records:
    """The judged cases of a report.

    folder: of the kept files. machine: in words; times of another one are not reused. map_size: of the maps
    that are measured.
    """

    folder: Path
    machine: str
    map_size: int

    @cached_property
    def code(self) -> str:
        """The fingerprint of the code."""
        return code_fingerprint()

    def scores(self, case: Case, entrant: Entrant | None) -> CaseScores:
        """The kept scores of a method, None for the simulation, or those of judging it now, then kept.

        Raises InputError as judging does.
        """
        path = self.path(case, entrant)
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
        judged = _judged(case, entrant)
        # Offsets from the simulation are small, so half precision keeps them well within a millimetre.
        offset = (judged.shown - truth).half()
        arrays = {"offset": offset.numpy()}
        for index, scores in enumerate(judged.parts.values()):
            arrays |= {f"{_prefix(index)}{key}": values.numpy() for key, values in scores.items()}
        keep_arrays(path, SCORES_FORMAT, arrays)
        # A rerun, which reads the file, is to give the same report.
        return CaseScores(judged.parts, truth + offset.float())

    def path(self, case: Case, entrant: Entrant | None) -> Path:
        """The file of a method on a case; None is the simulation."""
        name, content = (entrant.name, entrant.fingerprint) if entrant else (SIMULATION, "")
        body = case.outfit.body.identity.whole
        settings = (self.code, body, self.map_size, self.machine, content, case.turned)
        garments = [garment_fingerprint(garment) for garment in case.outfit.garments]
        contents = [
            content_hash(garment, clip.transforms)
            for clip in (case.clip, *case.members)
            for garment in clip.garments
        ]
        text = "/".join(map(str, (SCORES_FORMAT, *settings, *garments, *contents, len(case.transforms))))
        return self.folder / f"{case.name}_{name}_{fingerprint(text)[:16]}.npz"


def _judged(case: Case, entrant: Entrant | None) -> CaseScores:
    if entrant is None:
        return judge_simulation(case)
    return judge_prediction(case, entrant) if isinstance(entrant, Prediction) else judge(case, entrant)


def _prefix(part: int) -> str:
    """The prefix of the names of a part's scores in a file."""
    return f"part{part}/"


def code_fingerprint() -> str:
    """Hash of the sources and data that decide a score: kept results of other code are not reused."""
    contents: list[str | bytes] = []
    for package in (rasterize, uvcloth):
        folder = Path(str(package.__file__)).parent
        for path in sorted(path for kind in DECIDING for path in folder.rglob(kind)):
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
