"""`uvcloth rollout`: its options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import (
    DEVICE,
    EXTRAS,
    MOTION,
    BodyFile,
    Dynamics,
    FitOptions,
    GarmentFiles,
    GarmentsInOrder,
    Models,
    MotionFile,
    Port,
    Quality,
    TemplateName,
    Threads,
    Wrinkled,
    WrinklesFrom,
)
from uvcloth.errors import InputError
from uvcloth.files.options import NewFile, Several, Text
from uvcloth.methods.finish_names import FinishName
from uvcloth.motion.options import MotionOptions
from uvcloth.writers.shot import CameraName

ANIMATIONS = (".glb", ".usdc", ".usd", ".pc2", ".abc", ".obj", ".npz", ".mp4", ".gif", ".png")
"""Suffixes of the files that are written."""


@dataclass(frozen=True)
class Rollout(Command):
    """Move garments over a motion, and write files for engines, DCCs and players."""

    motion: Annotated[str, MOTION]
    """A motion file (BVH, glTF, FBX, AMASS) or the name of a built-in clip."""
    garment: GarmentsInOrder
    out: Annotated[
        tuple[Path, ...],
        arg(
            metavar="FILE ...",
            help="One or more files; the suffix chooses the format: .glb, .usdc, .abc, .pc2, .obj, .npz for "
            "other programs, .mp4 or .gif for a video, .png for a contact sheet.",
            help_behavior_hint="",
        ),
        NewFile(ANIMATIONS, EXTRAS),
        Several(distinct=True),
    ] = ()
    model: Models = ()
    finish: Annotated[
        FinishName | None,
        arg(
            metavar="dynamic|static|clear|none",
            help="Last step after a model. dynamic: the cloth solver moves the garments and is pulled to the "
            "prediction. static: they come to rest in each pose. clear: vertices are moved off the body "
            "and off the garments below. none: the plain prediction; a DeePSD model then includes its "
            "branch of physics, as in an export.",
            help_behavior_hint="(default: dynamic for trained models; clear for lbs, lbs_smooth and "
            "garments that the solver cannot hold up)",
        ),
    ] = None
    quality: Quality = "default"
    wrinkles: Wrinkled = False
    plain: bool = False
    """No wrinkles in videos and pictures of T-shirts, which have them by default."""
    wrinkles_from: WrinklesFrom = None
    template: Annotated[
        tuple[TemplateName | Literal["auto"], ...],
        arg(metavar="NAME|auto ...", help_behavior_hint="(default: the one each covers best)"),
    ] = ()
    """Template that a PhysXNet predicts a garment as: one for all, or one for each in order."""
    dynamics: Dynamics = None
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    loop: bool = False
    """Close a cyclic motion, such as two steps of a walk: garments end as they start. The last frame is the
    first one again, as players expect it; videos leave it out."""
    preview: bool = False
    """Quick look: every third frame, in small pictures; fastest with a single .png."""
    camera: Annotated[
        CameraName | None, arg(metavar="front|side|back|close|follow", help_behavior_hint="")
    ] = None
    """Camera of pictures and videos: front, side or back of the body as it faces in the first frame; close:
    its upper part; follow: turns with it."""
    size: Annotated[
        str | None,
        arg(metavar="WIDTHxHEIGHT", help_behavior_hint=""),
        Text(r"[1-9]\d{1,3}x[1-9]\d{1,3}", "WIDTHxHEIGHT in pixels, 10 to 9999 each"),
    ] = None
    """Size of pictures and videos, of each picture on a sheet."""
    keep_going: bool = False
    """Continue where a garment tears: that frame shows it as linear blend skinning moves it."""
    view: bool = False
    """Show the frames in the browser while they are computed, until Ctrl-C."""
    port: Port = 8080
    """Port of the live view on this machine, 1 to 65535."""
    hide_skin: Annotated[
        bool,
        arg(
            help="Leave out body faces that garments cover closely in every frame, and those that MakeHuman "
            "clothes hide (delete_verts)."
        ),
    ] = False
    device: Annotated[str, arg(metavar="cpu|cuda"), DEVICE] = "cpu"
    """Device of the computation."""
    threads: Threads = 1
    """Number of CPU threads; on a loaded machine several are slower than one."""
    fitting: GarmentFiles = field(default_factory=FitOptions)
    options: MotionFile = field(default_factory=MotionOptions)

    def check(self) -> None:
        """See Command."""
        if not self.garment or not (self.out or self.view):
            raise InputError("rollout: name at least one garment and one file to write, or --view")
        if self.loop and self.preview:
            raise InputError("--loop: --preview leaves out frames that a loop needs, choose one of the two")
        if self.wrinkles_from and not self.wrinkles:
            raise InputError("--wrinkles-from: goes with --wrinkles")
        if self.wrinkles and self.plain:
            raise InputError("--wrinkles: --plain leaves them out, choose one of the two")
        if self.wrinkles and self.loop:
            raise InputError("--wrinkles: cannot be closed into a loop yet, leave out --loop")
