"""`uvcloth maps`: its options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import NPZ, BodyFile
from uvcloth.files.options import Between, NewFolder, Text


@dataclass(frozen=True)
class Maps(Command):
    """Write body velocity, body acceleration, garment offset and masks of a simulated sequence as UV maps."""

    sequence: Positional[Annotated[Path, NPZ]]
    """A sequence npz made by `uvcloth simulate`."""
    out: Annotated[Path, NewFolder()]
    """Folder for one EXR file per frame and contact_sheet.png."""
    size: Annotated[int, Between(1, 8192)] = 256
    """Texels along each side of the maps."""
    frames: Annotated[
        str,
        arg(metavar="FIRST:END:STEP"),
        Text(r"(-?\d{0,9}:){0,2}-?\d{0,9}", "FIRST:END:STEP, such as 0:60:10"),
    ] = "::10"
    """Frames, as a Python slice."""
    body: BodyFile = None
    """The body that the sequence was simulated on."""
