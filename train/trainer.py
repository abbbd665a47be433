"""An entry of the registry of trainers."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol


class TrainingRun(Protocol):
    """The settings of a training, a frozen dataclass whose fields are the options of the command line."""

    @property
    def out(self) -> Path:
        """Folder of the run."""
        ...

    def train(self) -> dict[str, float]:
        """Train; returns the validation scores of the network kept."""
        ...


@dataclass(frozen=True)
class TrainerEntry:
    """How a method is trained.

    run: what the command line is parsed into; its field `preset`, where there are presets, names one of them.
    presets: by name, what fields of the run start from; the first is the usual one.
    """

    run: type[TrainingRun]
    presets: Mapping[str, Mapping[str, Any]]
