"""Cases: a mutated copy of a target's good files, known by target, seed and number."""

import shutil
from pathlib import Path
from random import Random

from tests.fuzz.mutators import mutate
from tests.fuzz.target import Target


class Corpus:
    """Good files of one target in a folder, and copies of them to mutate."""

    def __init__(self, target: Target, folder: Path) -> None:
        self.target, self.folder = target, folder
        self.good = folder / "good"
        self.good.mkdir(parents=True)
        self.inside = target.make(self.good).relative_to(self.good)

    def copy(self, folder: Path) -> Path:
        """Copy the good files into a folder that is made anew; returns the path to read."""
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(self.good, folder, symlinks=True)
        return folder / self.inside

    def case(self, seed: int, number: int, folder: Path) -> tuple[Path, str]:
        """Make a case in a folder that is made anew; returns the path to read, and what was done."""
        path = self.copy(folder)
        random = Random(f"{seed}/{self.target.name}/{number}")
        return path, mutate(folder, self.target.mutators, random)
