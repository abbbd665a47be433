"""`uvcloth maps`: its options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uvcloth.commands.options import BodyFile


@dataclass(frozen=True)
class Maps:
    """Write body velocity, body acceleration, garment offset and masks of a simulated sequence as UV maps."""

    sequence: Positional[Path]
    """A sequence npz made by `uvcloth simulate`."""
    out: Path
    """Folder for one EXR file per frame and contact_sheet.png."""
    size: int = 256
    """Texels along each side of the maps."""
    frames: Annotated[str, arg(metavar="FIRST:END:STEP")] = "::10"
    """Frames, as a Python slice."""
    body: BodyFile = None
    """The body that the sequence was simulated on."""
    layout: Annotated[Path | None, arg(metavar="NPZ", help_behavior_hint="(default: the body's)")] = None
    """Another UV layout of that body."""

    def run(self) -> None:
        """Write the maps. Raises InputError for bad input."""
        from uvcloth.commands.draw_maps import draw_maps

        print(
            f"{self.out}: {draw_maps(self)} EXR files; contact_sheet.png has velocity, acceleration, offset "
            "per frame"
        )
