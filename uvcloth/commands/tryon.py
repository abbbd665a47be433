"""`uvcloth tryon`: its options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import (
    JSON,
    PNG,
    BodyFile,
    FitOptions,
    GarmentFiles,
    GarmentsInOrder,
    Models,
    Quality,
)
from uvcloth.files.options import Between, InputPath

PHOTOGRAPH = InputPath((".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp"))


@dataclass(frozen=True)
class TryOn(Command):
    """Dress the person of a photograph: the body is posed by keypoints, and garments are drawn over it."""

    photo: Positional[Annotated[Path, PHOTOGRAPH]]
    """A photograph of a person, held level."""
    keypoints: Annotated[Path, JSON]
    """The person's keypoints in pixels, JSON of OpenPose (BODY_25, COCO) or COCO, as detectors of poses write
    them; of several persons the largest is dressed."""
    garment: GarmentsInOrder
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
    fitting: GarmentFiles = field(default_factory=FitOptions)
