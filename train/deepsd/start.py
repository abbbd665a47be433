"""A trained DeePSD that training goes on from."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uvcloth.checkpoint import TrainingData, load_checkpoint
from uvcloth.errors import InputError
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.methods.deepsd.method import DeePSD, load_deepsd
from uvcloth.methods.registry import SHIPPED

SHIPPED_MODEL = "shipped"
"""The name of the DeePSD in the package, instead of a run."""


@dataclass(frozen=True)
class TrainedStart:
    """A trained method to continue from, what it was made from, and the notes of its checkpoint."""

    method: DeePSD
    data: TrainingData
    notes: dict[str, Any]

    @property
    def fingerprint(self) -> str:
        """A hash of its weights."""
        return fingerprint(*self.method.network.state_dict().values())

    def joined(self, data: TrainingData) -> TrainingData:
        """The data of a model that goes on from it with these."""
        splits = self.data.clips | data.clips
        clips = {split: self.data.clips.get(split, {}) | data.clips.get(split, {}) for split in splits}
        return TrainingData(self.data.files | data.files, clips)


def load_start(run: str, option: str) -> TrainedStart:
    """The trained DeePSD of a run, or the one that ships, to continue from.

    option: that names it. Raises InputError if there is none, and if it is of another method.
    """
    folder = SHIPPED / "deepsd" if run == SHIPPED_MODEL else Path(run)
    checkpoint = load_checkpoint(folder)
    if checkpoint.method != "deepsd":
        raise InputError(f"{option} {run}: a model of method {checkpoint.method!r:.60}, expected deepsd")
    return TrainedStart(load_deepsd(checkpoint, folder), checkpoint.data, checkpoint.notes)
