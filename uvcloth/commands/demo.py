"""`uvcloth demo`: its options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from uvcloth.commands.command import Command
from uvcloth.commands.options import DASK, VIDEO
from uvcloth.files.options import NewFolder


@dataclass(frozen=True)
class Demo(Command):
    """Show a dress in a kick: simulated, by a network, by physics; a film, a baked character, a page."""

    out: Annotated[Path, NewFolder()] = Path("demo")
    """Folder for all results."""
    long: bool = False
    """Also a sudden stop, a T-shirt over trousers, garments from files, and a rig."""

    def check(self) -> None:
        """See Command."""
        DASK.require()
        VIDEO.require()
