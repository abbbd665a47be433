"""`uvcloth poses`: its options, and the drawing of poses."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import CSV, FOLDER, MOTIONS_OR_FOLDERS, SEED, BodyFile
from uvcloth.files.options import AtLeast, Between, NewFile


@dataclass(frozen=True)
class DrawPoses(Command):
    """Draw distinct poses without self-intersection of the body from motion capture."""

    out: Annotated[Path, NewFile((".npz",))]
    """The npz to write."""
    clips: Positional[
        Annotated[tuple[str, ...], arg(metavar="CLIP|DIR ...", help_behavior_hint=""), MOTIONS_OR_FOLDERS]
    ] = ()
    """Motion files (BVH, AMASS), folders of them, or names of built-in clips; by default, and without
    --windows, the built-in ones. An index.csv in a folder gives the splits."""
    windows: Annotated[Path | None, arg(metavar="CSV", help_behavior_hint=""), CSV] = None
    """Index of clips under any file name: poses are drawn from its clips."""
    clips_from: Annotated[Path | None, arg(metavar="DIR", help_behavior_hint=""), FOLDER] = None
    """Folder of those clips."""
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    apart: Annotated[float, Between(0.01, 3.2)] = 0.5
    """Least distance of two poses: at least one joint differs by this angle, radians."""
    every: Annotated[int, AtLeast(1)] = 1
    """Use one frame of N."""
    mirror: bool = True
    """Also draw training poses mirrored left to right."""
    recombine: Annotated[int, Between(0, 10**6)] = 2000
    """Additional training poses that combine legs, trunk and arms of several drawn poses."""
    seed: Annotated[int, SEED] = 0
    """Random seed."""
