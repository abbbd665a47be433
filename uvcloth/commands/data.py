"""`uvcloth data`: its options, and the listing, packing, unpacking and export of a folder of sequences."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uvcloth.commands.options import FOLDER
from uvcloth.errors import InputError
from uvcloth.files.options import Between, NewFolder


@dataclass(frozen=True)
class Data:
    """List the sequences of a folder, the refused ones with the reason, and those of its index that are
    missing.
    """

    folder: Positional[Annotated[Path, arg(metavar="DIR"), FOLDER]]
    """A folder made by `uvcloth simulate`; with --unpack, a packed folder."""
    pack: Annotated[Path | None, arg(metavar="OUT", help_behavior_hint=""), NewFolder()] = None
    """Pack the sequences into another folder instead, at about a twentieth of their size. Run it again to
    continue."""
    error: Annotated[float, arg(metavar="MM"), Between(0.01, 100)] = 1.0
    """Mean error of the vertices of a packed sequence; 99 % are within three times as much, all within six
    times. Half the error doubles the size."""
    unpack: Annotated[Path | None, arg(metavar="OUT", help_behavior_hint=""), NewFolder()] = None
    """Unpack a packed folder into another one instead, for training and evaluation."""
    export: Annotated[Path | None, arg(metavar="OUT", help_behavior_hint=""), NewFolder()] = None
    """Write body, motion, garments and simulation of the validation and test sequences as USD and Alembic
    instead, for other programs; `uvcloth evaluate --predicted` judges what they make of them."""

    def run(self) -> None:
        """List, pack, unpack or export. Raises InputError for bad input."""
        if sum(target is not None for target in (self.pack, self.unpack, self.export)) > 1:
            raise InputError("data: give --pack, --unpack or --export, not several")
        if self.pack:
            from uvcloth.dataset.packed import pack_folder

            print(f"{self.pack}: {pack_folder(self.folder, self.pack, 1e-3 * self.error)} sequences packed")
            return
        if self.unpack:
            from uvcloth.dataset.packed import unpack_folder

            print(f"{self.unpack}: {unpack_folder(self.folder, self.unpack)} sequences unpacked")
            return
        if self.export:
            from uvcloth.export.benchmark import export_benchmark

            print(f"{self.export}: {export_benchmark(self.folder, self.export)} sequences written")
            return
        from rich.console import Console

        from uvcloth.simulate.overview import overview

        Console().print(overview(self.folder), soft_wrap=True)
