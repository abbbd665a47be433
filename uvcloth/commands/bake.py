"""`uvcloth bake`: its options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import (
    CHARACTERS,
    MOTION,
    Fabrics,
    FromBody,
    GarmentPose,
    GarmentsInOrder,
    Holds,
    MotionFile,
    OnCharacter,
    Quality,
    Tucks,
    Wrinkled,
    WrinklesFrom,
)
from uvcloth.errors import InputError
from uvcloth.files.options import InputPath, NewFile
from uvcloth.motion.options import MotionOptions


@dataclass(frozen=True)
class Bake(Command):
    """Dress a character for the runtime: one glTF binary that viewers show and `uvcloth play` moves."""

    garment: GarmentsInOrder
    out: Annotated[Path, NewFile((".glb",))]
    """File to write: .glb."""
    body: Annotated[
        Path | None,
        arg(metavar="GLB|NPZ", help_behavior_hint="(default: the one in the package)"),
        InputPath((*CHARACTERS, ".npz")),
    ] = None
    """A rigged character, whose file is kept as it is and gets the garments, or a body made by `uvcloth
    body`."""
    motion: Annotated[
        str | None,
        arg(metavar="FILE|NAME", help_behavior_hint="(default: the animations of the character)"),
        MOTION,
    ] = None
    """A motion file or the name of a built-in clip, which becomes the first animation of the file."""
    quality: Quality = "default"
    wrinkles: Wrinkled = False
    wrinkles_from: WrinklesFrom = None
    tuck: Tucks = ()
    hold: Holds = ()
    garment_pose: GarmentPose = None
    on_character: OnCharacter = False
    from_body: FromBody = None
    fabric: Fabrics = ()
    """Fabric of the garments: one for all, or one for each."""
    options: MotionFile = field(default_factory=MotionOptions)

    def check(self) -> None:
        """See Command."""
        if self.wrinkles_from and not self.wrinkles:
            raise InputError("--wrinkles-from: goes with --wrinkles")
