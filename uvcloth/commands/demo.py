"""`uvcloth demo`: its options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from uvcloth.commands.options import DASK, VIDEO
from uvcloth.files.options import NewFolder


@dataclass(frozen=True)
class Demo:
    """Show a dress in a kick: simulated, by a network, by physics; a film, a baked character, a page."""

    out: Annotated[Path, NewFolder()] = Path("demo")
    """Folder for all results."""
    long: bool = False
    """Also a sudden stop, a T-shirt over trousers, garments from files, and a rig."""

    def run(self) -> None:
        """Write all results. Raises InputError without dask or PyAV, or if the folder cannot be written."""
        DASK.require()
        VIDEO.require()
        from uvcloth.commands.demonstrate import demonstrate

        demonstrate(self.out, self.long)
