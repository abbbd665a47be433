"""`uvcloth tryon`: its options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import (
    GARMENT,
    JSON,
    PNG,
    TEMPLATE_NAMES,
    BodyFile,
    Fabrics,
    FromBody,
    GarmentPose,
    Holds,
    Models,
    Quality,
    Tucks,
)
from uvcloth.files.options import Between, InputPath, Several

PHOTOGRAPH = InputPath((".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp"))


@dataclass(frozen=True)
class TryOn(Command):
    """Dress the person of a photograph: the body is posed by keypoints, and garments are drawn over it."""

    photo: Positional[Annotated[Path, PHOTOGRAPH]]
    """A photograph of a person, held level."""
    keypoints: Annotated[Path, JSON]
    """The person's keypoints in pixels, JSON of OpenPose (BODY_25, COCO) or COCO, as detectors of poses write
    them; of several persons the largest is dressed."""
    garment: Annotated[
        tuple[str, ...],
        arg(
            metavar="NAME|FILE ...",
            help=f"Templates ({TEMPLATE_NAMES}) or garment files, the innermost first.",
        ),
        GARMENT,
        Several(least=1),
    ]
    out: Annotated[Path, PNG]
    """The picture to write, in the size of the photograph."""
    fitted: Annotated[Path | None, arg(metavar="PNG", help_behavior_hint=""), PNG] = None
    """Also a picture of the fitted body and of the keypoints, to judge the fit by."""
    view: Annotated[float, arg(metavar="DEGREES"), Between(5, 120)] = 45.0
    """Vertical field of view of the camera."""
    body: BodyFile = None
    """A body made by `uvcloth body`, in the shape of the person."""
    model: Models = ()
    quality: Quality = "default"
    tuck: Tucks = ()
    hold: Holds = ()
    garment_pose: GarmentPose = None
    from_body: FromBody = None
    fabric: Fabrics = ()
    """Fabric of the garments: one for all, or one for each."""
