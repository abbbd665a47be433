"""`uvcloth bake`: its options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import (
    CHARACTERS,
    MOTION,
    FitOptions,
    GarmentFiles,
    GarmentsInOrder,
    MotionFile,
    OnCharacter,
    Quality,
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
    on_character: OnCharacter = False
    fitting: GarmentFiles = field(default_factory=FitOptions)
    options: MotionFile = field(default_factory=MotionOptions)

    def check(self) -> None:
        """See Command."""
        if self.wrinkles_from and not self.wrinkles:
            raise InputError("--wrinkles-from: goes with --wrinkles")
