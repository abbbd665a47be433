"""`uvcloth export`: its options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import (
    MOTION,
    ONNX,
    TRAINED,
    BodyFile,
    Dynamics,
    Fabric,
    Garments,
    MotionFile,
)
from uvcloth.files.options import Between, NewFile
from uvcloth.methods.registry import list_rigs
from uvcloth.motion.options import MotionOptions


@dataclass(frozen=True)
class Export(Command):
    """Write a rig (PBNS, DeePSD, recurrent) for engines: skeleton, skin, blend shapes and motion."""

    model: Annotated[str, arg(metavar="NAME|RUN", help=f"A shipped model, {list_rigs()}, or {TRAINED}.")]
    out: Annotated[Path, NewFile((".glb", ".usdc", ".usd"))]
    """File to write: .glb, .usdc or .usd."""
    garment: Garments = ()
    """Templates, for DeePSD garment files too, the innermost first. PBNS contains its garments."""
    fabric: Fabric = None
    """Fabric of the garments, for DeePSD models."""
    dynamics: Dynamics = None
    motion: Annotated[
        str | None,
        arg(
            metavar="FILE|NAME",
            help="A motion file or the name of a built-in clip. Without it, the network is also "
            "written, as .onnx, for engines that compute the blend shape weights.",
            help_behavior_hint="(default: the rig alone)",
        ),
        MOTION,
    ] = None
    shapes: Annotated[
        int | None, arg(metavar="K", help_behavior_hint="(default: all)"), Between(1, 10000)
    ] = None
    """Number of blend shapes to keep: principal components of the deformations in the training poses."""
    body: BodyFile = None
    """The body that the model was trained on."""
    with_body: bool = True
    """Write the body too."""
    options: MotionFile = field(default_factory=MotionOptions)

    def check(self) -> None:
        """See Command."""
        if self.motion is None:
            ONNX.require()
