"""`uvcloth view`: its options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import MOTION, NPZ, BodyFile, Garments, Host, Port
from uvcloth.files.options import InputPath, Several
from uvcloth.methods.registry import DEFAULT, METHODS


@dataclass(frozen=True)
class View(Command):
    """Choose and play rollouts in the browser, computed while they play."""

    motion: Positional[
        Annotated[tuple[str, ...], arg(metavar="CLIP ...", help_behavior_hint=""), MOTION]
    ] = ()
    """Motion files to choose from, in addition to the built-in clips."""
    garment: Garments = ("tops",)
    """Templates or garment files to start with, the innermost first."""
    model: Annotated[
        tuple[str, ...],
        arg(
            metavar="NAME|RUN ...",
            help="Folders written by `uvcloth train` to choose from, in addition to "
            f"{', '.join(METHODS)}; or one of these names. The first is shown first.",
            help_behavior_hint=f"(default: {DEFAULT})",
        ),
        InputPath(kind="folder", names=lambda: tuple(METHODS)),
        Several(),
    ] = ()
    body: BodyFile = None
    """A body made by `uvcloth body`."""
    data: Annotated[tuple[Path, ...], arg(metavar="SEQUENCE ...", help_behavior_hint=""), NPZ] = ()
    """Sequences made by `uvcloth simulate`, shown next to the prediction, with its error as a heat map."""
    port: Port = 8080
    """Port of the page, 1 to 65535. Its address has a token, without which requests are refused."""
    host: Host = "127.0.0.1"
    """Address to listen on; 0.0.0.0 admits other machines that have the token."""
