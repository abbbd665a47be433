"""`uvcloth outfits`: its options, and their ranges."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import ANNY, PNG, REMESHER, SEED, Jobs
from uvcloth.errors import InputError
from uvcloth.files.options import Between, InputPath, NewFolder, Several

FEWEST_VERTICES, MOST_VERTICES = 1000, 16000


@dataclass(frozen=True)
class Outfits(Command):
    """Make random outfits on bodies as training data: a JSON and OBJ files for each."""

    count: Annotated[int, Between(1, 100_000)]
    """Number of outfits; run it again to continue."""
    out: Annotated[Path, NewFolder()]
    """Folder for o0001.json, its pieces o0001_tshirt.obj, ..., and bodies/."""
    body: Annotated[
        tuple[str, ...],
        arg(
            metavar="NPZ|builtin ...",
            help="Bodies made by `uvcloth body`, or `builtin` for the one in the package: one, or at least "
            "three, so that no body is in two splits. Without this option, bodies are drawn from phenotypes.",
            help_behavior_hint="",
        ),
        InputPath((".npz",), names=lambda: ("builtin",)),
        Several(most=1000, distinct=True),
    ] = ()
    bodies: Annotated[int, arg(metavar="K"), Between(1, 1000)] = 12
    """Number of bodies to draw."""
    seed: Annotated[int, SEED] = 0
    """Random seed: the same seed gives the same outfits."""
    vertices: Annotated[
        tuple[int, int], arg(metavar="LEAST MOST"), Between(FEWEST_VERTICES, MOST_VERTICES)
    ] = (1000, 2500)
    """Range of the number of vertices of an outfit, within 1000 to 16000."""
    type: Annotated[
        tuple[str, ...],
        arg(
            metavar="NAME ...",
            help="Types of outfits: tshirt, top, longsleeve, jacket, trousers, shorts, skirt, gown, "
            "jumpsuit, or an upper piece over a lower one, such as tshirt+skirt.",
            help_behavior_hint="(default: all)",
        ),
        Several(distinct=True),
    ] = ()
    jobs: Jobs = None
    """Number of processes."""
    picture: Annotated[Path | None, arg(metavar="PNG", help_behavior_hint=""), PNG] = None
    """Also draw a contact sheet of the first 48 outfits."""

    def check(self) -> None:
        """Raise InputError for an unknown type, numbers that do not go together, or a missing package."""
        from uvcloth.wardrobe.draw import OUTFITS

        REMESHER.require()
        if not self.body:
            ANNY.require()
        low, high = self.vertices
        if low > high:
            raise InputError(f"--vertices {low} {high}: expected the smaller number first")
        for name in self.type:
            if name not in OUTFITS:
                raise InputError(f"--type {name}: unknown, expected one of {', '.join(OUTFITS)}")
        bodies = len(self.body) or self.bodies
        if bodies < 1 or bodies == 2:
            option = "--body" if self.body else "--bodies"
            raise InputError(
                f"{option}: {bodies} bodies, expected one for all, or at least three to split them"
            )
