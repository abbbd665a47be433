"""`uvcloth fit`: its options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, get_args

from tyro.conf import Positional, arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import PNG, BodyFile, FromBody, GarmentPose, TemplateName
from uvcloth.files.options import Between, InputPath, NewFile


@dataclass(frozen=True)
class Fit(Command):
    """Explain a garment file, and check that it lies on the body as clothes do."""

    file: Positional[Annotated[Path, InputPath()]]
    """A garment mesh (OBJ, PLY, GLB or STL), in any unit, Y or Z up, modelled on this body or another; or
    MakeHuman clothes (MHCLO with its OBJ)."""
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    template: Annotated[
        TemplateName | None,
        arg(
            metavar="|".join(get_args(TemplateName)),
            help_behavior_hint="(default: the one that it covers best)",
        ),
    ] = None
    """Template that a PhysXNet predicts it as."""
    garment_pose: GarmentPose = None
    from_body: FromBody = None
    shift: Annotated[
        tuple[float, float, float] | None,
        arg(metavar="X Y Z", help_behavior_hint="(default: found)"),
        Between(-100, 100),
    ] = None
    """Metres by which the garment is moved, X to its left, Y backwards, Z up, after scale and turn."""
    scale: Annotated[
        float | None, arg(metavar="S", help_behavior_hint="(default: found)"), Between(0, 1e6, above=True)
    ] = None
    """Metres in one unit of the file."""
    turn: Annotated[
        float | None, arg(metavar="DEGREES", help_behavior_hint="(default: found)"), Between(-360, 360)
    ] = None
    """Turn about the vertical, counter-clockwise from above; 0 if the file faces +Z (Y up) or -Y (Z up)."""
    out: Annotated[Path | None, arg(metavar="OBJ", help_behavior_hint=""), NewFile((".obj",))] = None
    """Also write the placed garment as OBJ (metres, Z up); several garments go into separate files."""
    picture: Annotated[Path | None, arg(metavar="PNG"), PNG] = Path("fit.png")
    """Picture of the garment on the body at rest, also if it is refused, and as cloth in a dance; None for no
    picture."""
