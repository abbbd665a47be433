"""`uvcloth page`: its options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import NPZ, TRAINED, BodyFile
from uvcloth.files.options import InputPath, NewFolder, Several, Text
from uvcloth.methods.registry import list_methods


@dataclass(frozen=True)
class Page(Command):
    """Write a web page on which clothes move without a server: a folder for any host, or one file."""

    out: Annotated[Path, NewFolder(or_file=".html")]
    """Folder to write, or, where it ends in .html, one file that a double click opens."""
    file: Positional[
        Annotated[
            tuple[Path, ...],
            arg(metavar="GLB", help_behavior_hint="(default: a dress, and trousers with a shirt)"),
            InputPath((".glb",)),
        ]
    ] = ()
    """Files that `uvcloth bake` wrote, with their animations."""
    fast: Annotated[
        tuple[Path, ...],
        arg(
            metavar="GLB ...",
            help="The same characters in the same garments, baked with `--quality fast`, in the same order: "
            "slow machines take that quality, and a visitor may.",
            help_behavior_hint="",
        ),
        InputPath((".glb",)),
    ] = ()
    simulated: Annotated[
        Path | None,
        arg(
            metavar="NPZ",
            help="A sequence that `uvcloth simulate` wrote: the page plays its motion, and draws the error "
            "of each method against it. The file has to wear that garment alone; without one, the template "
            "of that name is baked on the body.",
            help_behavior_hint="",
        ),
        NPZ,
    ] = None
    predicted: Annotated[
        tuple[str, ...],
        arg(
            metavar="NAME=FILE ...",
            help="With --simulated: the same sequence by other methods, as `uvcloth rollout` or other "
            "programs write it (.npz, .pc2, .mdd, .abc, .usd), played from stored frames.",
            help_behavior_hint="",
        ),
        Text(r"[^=]+=.+", "NAME=FILE"),
    ] = ()
    model: Annotated[
        tuple[str, ...],
        arg(
            metavar="NAME|RUN ...",
            help=f"With --simulated: methods over its motion, without a finish: {list_methods()}; or "
            f"{TRAINED}. Those that are rigs are played by the visitor's browser, others from stored frames.",
            help_behavior_hint="",
        ),
        Several(distinct=True),
    ] = ()
    body: BodyFile = None
    """With --simulated: the body of the simulation, made by `uvcloth body`."""
