"""`uvcloth data`: its options, and the listing, packing, unpacking and export of a folder of sequences."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uvcloth.commands.command import Command
from uvcloth.commands.options import FOLDER
from uvcloth.errors import InputError
from uvcloth.files.options import Between, NewFolder


@dataclass(frozen=True)
class Data(Command):
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

    def check(self) -> None:
        """See Command."""
        if sum(target is not None for target in (self.pack, self.unpack, self.export)) > 1:
            raise InputError("data: give --pack, --unpack or --export, not several")
