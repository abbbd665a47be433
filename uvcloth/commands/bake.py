"""`uvcloth bake`: its options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from uvcloth.commands.options import (
    GARMENT,
    MOTION,
    TEMPLATE_NAMES,
    Fabrics,
    FromBody,
    GarmentPose,
    Holds,
    MotionFile,
    Tucks,
)
from uvcloth.files.options import NewFile, Several, Source
from uvcloth.motion.options import MotionOptions

CHARACTERS = (".glb", ".gltf", ".vrm", ".fbx")
"""Suffixes of rigged characters."""


@dataclass(frozen=True)
class Bake:
    """Dress a character for the runtime: one glTF binary that viewers show and `uvcloth play` moves."""

    garment: Annotated[
        tuple[str, ...],
        arg(
            metavar="NAME|FILE ...",
            help=f"Templates ({TEMPLATE_NAMES}) or garment files, in the order in which they are worn, the "
            "innermost first.",
        ),
        GARMENT,
        Several(least=1),
    ]
    out: Annotated[Path, NewFile((".glb",))]
    """File to write: .glb."""
    body: Annotated[
        Path | None,
        arg(metavar="GLB|NPZ", help_behavior_hint="(default: the one in the package)"),
        Source((*CHARACTERS, ".npz")),
    ] = None
    """A rigged character, whose file is kept as it is and gets the garments, or a body made by `uvcloth
    body`."""
    motion: Annotated[
        str | None,
        arg(metavar="FILE|NAME", help_behavior_hint="(default: the animations of the character)"),
        MOTION,
    ] = None
    """A motion file or the name of a built-in clip, which becomes the first animation of the file."""
    quality: Literal["fast", "default", "fine"] = "default"
    """Size of the faces that the cloth solver moves: edges of about 57, 40 or 30 mm."""
    tuck: Tucks = ()
    hold: Holds = ()
    garment_pose: GarmentPose = None
    from_body: FromBody = None
    fabric: Fabrics = ()
    """Fabric of the garments: one for all, or one for each."""
    options: MotionFile = field(default_factory=MotionOptions)

    def run(self) -> None:
        """Write the file and say what is in it. Raises InputError for bad input."""
        from uvcloth.commands.bake_file import bake
        from uvcloth.methods.physics.outfit import bake_outfit

        print("\n".join(bake(self, bake_outfit).lines()))
