"""`uvcloth play`: its options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import EXTRAS, FABRIC_NAMES, MOTION, MotionFile
from uvcloth.errors import InputError
from uvcloth.files.options import InputPath, NewFile
from uvcloth.motion.options import MotionOptions
from uvcloth.physics.fabric import FabricName

PLAYED = (".glb", ".usdc", ".usd", ".pc2", ".abc", ".obj", ".npz")
"""Suffixes of the files that are written."""


@dataclass(frozen=True)
class Play(Command):
    """Play a baked file: its cloth moves with an animation of the file, or with another motion."""

    file: Positional[Annotated[Path, InputPath((".glb",))]]
    """A .glb that `uvcloth bake` wrote."""
    out: Annotated[Path, NewFile(PLAYED, EXTRAS)]
    """File to write. .glb: the character and its garments; .usdc, .abc, .pc2, .obj, .npz: the garments."""
    motion: Annotated[
        str | None, arg(metavar="FILE|NAME", help_behavior_hint="(default: of the file)"), MOTION
    ] = None
    """A motion file or the name of a built-in clip instead of an animation of the file."""
    options: MotionFile = field(default_factory=MotionOptions)
    wind: Annotated[tuple[float, float, float], arg(metavar="X Y Z")] = (0.0, 0.0, 0.0)
    """Wind, m/s, along the axes X, Y and Z, which points up. The body does not shield cloth from it."""
    gravity: float = 9.81
    """Gravity, m/s2."""
    fabric: Annotated[
        tuple[FabricName, ...],
        arg(metavar=f"{FABRIC_NAMES} ...", help_behavior_hint="(default: those that were baked)"),
    ] = ()
    """Weight and stiffness of the garments: one fabric for all, or one for each; friction and drag stay."""

    def check(self) -> None:
        """See Command."""
        options = self.options
        if self.motion is None and (
            options.up or options.joints or options.rest_frame is not None or options.in_place
        ):
            raise InputError("play: --up, --joints, --rest-frame and --in-place need --motion")
