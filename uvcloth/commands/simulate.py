"""`uvcloth simulate`: its options, and their valid combinations."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import (
    CSV,
    DASK,
    FABRIC_NAMES,
    FOLDER,
    BodyFile,
    Garments,
    Jobs,
    MotionFile,
)
from uvcloth.errors import InputError
from uvcloth.files.options import AtLeast, Between, NewFolder, Text
from uvcloth.motion.options import MotionOptions
from uvcloth.physics.fabric import FabricName

EngineName = Literal["explicit", "blender"]

RUNNING = ("out", "clips_from", "engine", "edge", "fabric", "jobs", "scheduler")
"""Options of every simulation."""


@dataclass(frozen=True)
class Simulate(Command):
    """Simulate garments over clips with a cloth engine; run it again to continue."""

    clips: Positional[Annotated[tuple[str, ...], arg(metavar="CLIP ...", help_behavior_hint="")]]
    """Motion files (BVH, glTF, FBX, AMASS) or names of built-in clips."""
    out: Annotated[Path, NewFolder()]
    """Folder for the sequences, one npz per clip and garment."""
    garment: Garments = ("tops", "bottoms", "dress")
    """Templates or garment files to simulate; sequences of a file take the name of the file."""
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    plan: Annotated[
        Path | None,
        arg(
            metavar="CSV",
            help="Simulate the rows of a table instead. Columns: clip, start, frames (a window at 30 fps), "
            "garments (joined by + if worn together), split, subject, action; optional: name (of the "
            "window), hold (seconds to stand still at its end), body (a file relative to the table), member "
            "(of an ensemble, 1 to 3). Other bodies, layers and members get separate folders in OUT.",
            help_behavior_hint="",
        ),
        CSV,
    ] = None
    outfits: Annotated[
        Path | None,
        arg(
            metavar="DIR",
            help="Simulate the outfits of this folder, made by `uvcloth outfits`, instead: each on its body, "
            "over one window of its split in the table.",
            help_behavior_hint="",
        ),
        FOLDER,
    ] = None
    most_frames: Annotated[
        int | None, arg(metavar="N", help_behavior_hint="(default: whole windows)"), AtLeast(1)
    ] = None
    """With --outfits: at most the first N frames of each window."""
    layered: Annotated[
        bool,
        arg(
            help="Simulate the garments together, worn over one another, the first innermost; otherwise each "
            "is simulated alone."
        ),
    ] = False
    engine: Annotated[
        EngineName,
        arg(
            help="Cloth solver: the project's explicit one, or Blender's, of the installation that "
            "UVCLOTH_BLENDER_PYTHON names."
        ),
    ] = "explicit"
    edge: Annotated[
        float | None,
        arg(metavar="M", help_behavior_hint="(default: the garment's own mesh)"),
        Between(0.004, 0.1),
    ] = None
    """Length of the edges of an even mesh that is simulated instead of a garment's own, in metres: 0.012 is
    converged to 2 mm, and folds where coarser meshes jam."""
    fabric: Annotated[
        FabricName | None,
        arg(
            metavar=FABRIC_NAMES,
            help_behavior_hint="(default: jersey; with --outfits each has its fabric)",
        ),
    ] = None
    """Fabric of the garments."""
    windows: Annotated[
        Path | None,
        arg(
            metavar="CSV",
            help="Simulate windows of clips: a table with the columns trial, subject, split, action, "
            "window_start and window_frames, which training and evaluation also use. Without clips, all "
            "clips of the table.",
            help_behavior_hint="(default: whole clips)",
        ),
        CSV,
    ] = None
    clips_from: Annotated[
        Path | None, arg(metavar="DIR", help_behavior_hint="(default: the table's)"), FOLDER
    ] = None
    """Folder of the clips of the table."""
    split: Annotated[
        tuple[Literal["train", "validation", "test"], ...] | None,
        arg(metavar="train|validation|test ...", help_behavior_hint="(default: all three)"),
    ] = None
    """Splits to simulate: validation comes first, then test, then training in a mixed order."""
    jobs: Jobs = None
    """Number of sequences to simulate at the same time."""
    scheduler: Annotated[
        str | None,
        arg(metavar="ADDRESS", help_behavior_hint=""),
        Text(r"(\w+://)?[\w.:%\[\]-]+:\d{1,5}", "an address such as tcp://127.0.0.1:8786"),
    ] = None
    """Address of a dask scheduler that runs the simulations instead of this machine."""
    ensemble: Annotated[
        bool,
        arg(
            help="Simulate everything four times, with another mesh, more substeps and both, into "
            "OUT/members. Evaluation reports how much of an error is chance."
        ),
    ] = False
    options: MotionFile = field(default_factory=MotionOptions)

    def check(self) -> None:
        """See Command."""
        if not (self.clips or self.windows or self.plan) or not self.garment:
            raise InputError(
                "simulate: name at least one clip (or --windows and a table) and one garment, or a --plan"
            )
        if self.plan:
            self._require_only(("plan",), "--plan, whose table contains it")
        elif self.outfits:
            allowed = ("outfits", "most_frames", "clips", "windows", "split", "options")
            self._require_only(allowed, "--outfits, whose files name garments and bodies")
        elif self.most_frames is not None:
            raise InputError("--most-frames: needs --outfits; choose frames of clips with --windows")
        DASK.require()

    def _require_only(self, names: tuple[str, ...], reason: str) -> None:
        """Raise InputError, with the reason, for an option that would have no effect.

        names: the options that are used in addition to RUNNING.
        """
        usual = Simulate(clips=(), out=self.out)
        for each in fields(self):
            if each.name not in (*RUNNING, *names) and getattr(self, each.name) != getattr(usual, each.name):
                name = "clips" if each.name == "clips" else f"--{each.name.replace('_', '-')}"
                raise InputError(f"{name}: not allowed with {reason}")
