"""Options of commands that take a motion: how its file is read, and which part of it is used."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from uvcloth.errors import InputError
from uvcloth.files.options import Between, InputPath, Text

FPS_RANGE = (1.0, 1000.0)
"""Least and greatest frame rate of a motion, frames per second."""

SPAN = r"-?\d{0,9}:-?\d{0,9}"
"""Pattern of frames A:B."""


@dataclass(frozen=True)
class MotionOptions:
    """Reading of a motion file, and the part of it to use."""

    up: Annotated[
        Literal["y", "z"] | None, arg(metavar="y|z", help_behavior_hint="(default: as the person stands)")
    ] = None
    """Axis of the file that points up. With it, the check that the person stands is left out."""
    joints: Annotated[
        Path | None,
        arg(metavar="JSON", help_behavior_hint="(default: by their names)"),
        InputPath((".json",)),
    ] = None
    """Roles of joints, {"hips": "Pelvis", ...}; `uvcloth motion FILE` lists the roles."""
    animation: Annotated[str | None, arg(metavar="NAME|N", help_behavior_hint="(default: the first)")] = None
    """Animation of a glTF or FBX file, by its name or number; `uvcloth motion FILE` lists them."""
    rest_frame: Annotated[
        int | None, arg(metavar="N", help_behavior_hint="(default: found)"), Between(0, 10**8)
    ] = None
    """Frame of the file, from 0, in which the person stands straight, arms anywhere to the sides."""
    fps: Annotated[float, arg(metavar="N"), Between(*FPS_RANGE)] = 30.0
    """Frames per second to resample the motion to, 1 to 1000."""
    frames: Annotated[
        str | None, arg(metavar="A:B", help_behavior_hint="(default: all)"), Text(SPAN, "A:B, frames or none")
    ] = None
    """Frames A to B - 1 of the motion at that rate."""
    in_place: bool = False
    """Keep the hips over one point of the floor."""
    clear_arms: bool = True
    """Turn the upper arms so that forearms and hands of a retargeted motion stay out of torso and legs."""

    def window(self, length: int) -> tuple[int, int]:
        """First frame and number of frames to use, of `length`. Raises InputError if there are none."""
        if self.frames is None:
            return 0, length
        first, colon, end = self.frames.partition(":")
        try:
            span = range(length)[slice(int(first) if first else None, int(end) if end else None)]
        except ValueError:
            span = range(0)
        if not colon or not span:
            raise InputError(f"--frames {self.frames}: expected A:B within the motion's {length} frames")
        return span.start, len(span)
