"""`uvcloth demo`: its options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from uvcloth.commands.options import DASK
from uvcloth.files.options import NewFolder


@dataclass(frozen=True)
class Demo:
    """Compare simulation, networks, networks over physics, and physics in a stop and a kick."""

    out: Annotated[Path, NewFolder()] = Path("demo")
    """Folder for all results."""

    def run(self) -> None:
        """Write all results. Raises InputError without dask, or if the folder cannot be written."""
        DASK.require()
        from uvcloth.commands.demonstrate import demonstrate

        demonstrate(self.out)
