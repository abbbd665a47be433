"""`uvcloth motion`: its options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import MOTION, PNG, BodyFile, MotionFile
from uvcloth.motion.options import MotionOptions


@dataclass(frozen=True)
class DescribeMotion(Command):
    """Explain how a motion file is understood, and draw it as stick figures."""

    file: Positional[Annotated[str, arg(metavar="FILE|NAME"), MOTION]]
    """A motion file (BVH, glTF, FBX, AMASS) or the name of a built-in clip."""
    out: Annotated[Path, PNG] = Path("motion.png")
    """The picture to write."""
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    options: MotionFile = field(default_factory=MotionOptions)
