"""`uvcloth page`: its options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from uvcloth.files.options import NewFolder, Source


@dataclass(frozen=True)
class Page:
    """Write a web page on which clothes move without a server: a folder for any host, or one file."""

    out: Annotated[Path, NewFolder(or_file=".html")]
    """Folder to write, or, where it ends in .html, one file that a double click opens."""
    file: Positional[
        Annotated[
            tuple[Path, ...],
            arg(metavar="GLB", help_behavior_hint="(default: a dress, and trousers with a shirt)"),
            Source((".glb",)),
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
        Source((".glb",)),
    ] = ()

    def run(self) -> None:
        """Write the page and say where it is. Raises InputError for bad input."""
        from uvcloth.commands.page_file import write_page

        print("\n".join(write_page(self).lines()))
