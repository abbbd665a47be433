"""Options of `rest`, which `uvcloth serve` runs: how garments lie on a character before they are baked."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import CHARACTERS, FitOptions, GarmentFiles
from uvcloth.files.options import InputPath, NewFile, Several


@dataclass(frozen=True)
class Rest(Command):
    """Say how garment files on a character are moved before they are baked, and write it as arrays."""

    garment: Annotated[tuple[str, ...], arg(metavar="FILE ..."), InputPath(), Several(least=1)]
    """Garment files in the axes, the unit and the bind pose of the character, the innermost first."""
    body: Annotated[Path, InputPath(CHARACTERS)]
    """A rigged character."""
    out: Annotated[Path, NewFile((".npz",))]
    """File to write: per garment NAME.vertices as the character's file has them, and the masks NAME.inside,
    NAME.beneath and NAME.left."""
    fitting: GarmentFiles = field(default_factory=FitOptions)
