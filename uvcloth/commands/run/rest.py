"""Garments as they come to lie on a character: their vertices at rest, and those that start wrong."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from uvcloth.commands.rest import Rest
from uvcloth.commands.run.wearer import load_wearer
from uvcloth.commands.run.worn import load_worn
from uvcloth.errors import InputError
from uvcloth.files.archive import save_arrays
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.garments.starts import starts


def run(command: Rest) -> None:
    """Write the file and say what is in it. Raises InputError for bad input."""
    print("\n".join(rest(command)))


def rest(command: Rest) -> list[str]:
    """Fit garment files to a character and write how they lie; returns a line on each, the innermost first.

    The file has, by the name of each garment's file, in the order of its N vertices: vertices (N, 3), in the
    axes, the unit and the pose of the character's file; inside (N,), those that start in the body; beneath,
    those that start beneath a garment that is worn under it; left, those that are either in the end too.
    Raises InputError for bad input, and for a file that holds several garments.
    """
    wearer = load_wearer(command.body, print)
    frame = wearer.require_frame("rest")
    outfit = load_worn(command.garment, command.fitting, wearer.body, print, frame=frame)
    paths = {Path(file).stem: Path(file) for file in command.garment}
    for name, path in paths.items():
        if name not in [garment.name for garment in outfit.garments]:
            raise InputError(f"{path}: holds several garments, separate it into one file for each")
    worn = [garment.mesh for garment in outfit.garments]
    made = [
        replace(mesh, vertices=frame.to_body(read_mesh(paths[garment.name]).vertices))
        for garment, mesh in zip(outfit.garments, worn, strict=True)
    ]
    lines: list[str] = []
    arrays: dict[str, np.ndarray] = {}
    before, after = starts(made, frame.posed(wearer.body)), starts(worn, wearer.body)
    for garment, start, end in zip(outfit.garments, before, after, strict=True):
        arrays |= {
            f"{garment.name}.vertices": frame.from_rest(garment).numpy(),
            f"{garment.name}.inside": start.inside.numpy(),
            f"{garment.name}.beneath": start.beneath.numpy(),
            f"{garment.name}.left": end.wrong.numpy(),
        }
        counts = (int(np.count_nonzero(each)) for each in (start.inside, start.beneath, end.wrong))
        lines.append(
            "{}: {} vertices start in the body, {} beneath what it is worn over; {} are left".format(
                garment.name, *counts
            )
        )
    save_arrays(command.out, arrays)
    return lines
