"""Contact sheet of a folder of outfits, each on its body at rest."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from uvcloth.bodies.body import load_body
from uvcloth.files.image import write_png
from uvcloth.rendering.lighting import COARSE
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS, Surface, contact_sheet, render, three_quarter
from uvcloth.wardrobe.outfit_file import OutfitFile, load_outfit_file, load_pieces

SHOWN = 48
"""Outfits on a sheet, at most."""

COLUMNS = 12

SIZE = (128, 184)
"""Width and height of a picture, in pixels."""

TURNS = (25.0, 25.0, 205.0)
"""Degrees around the body from which outfits are seen, in turn: every third from behind."""


def draw_sheet(files: Sequence[Path], out: Path) -> None:
    """Write a PNG of the first SHOWN outfits.

    Raises InputError for an outfit that cannot be read, or if the picture cannot be written.
    """
    shown = track(files[:SHOWN], f"drawing {out.name}", console=Console(stderr=True))
    pictures = [_picture(load_outfit_file(path), number) for number, path in enumerate(shown)]
    write_png(out, contact_sheet(pictures, min(COLUMNS, len(pictures)), gap=2))


def _picture(outfit: OutfitFile, number: int) -> np.ndarray:
    skin = load_body(outfit.body).mesh
    surfaces = [Surface(skin.vertices, skin.faces, BODY_COLOR)]
    for layer, piece in enumerate(load_pieces(outfit)):
        color = GARMENT_COLORS[(number + layer) % len(GARMENT_COLORS)]
        surfaces.append(Surface(piece.vertices, piece.faces, color))
    camera = three_quarter(skin.vertices, TURNS[number % len(TURNS)], aspect=SIZE[0] / SIZE[1])
    return render(surfaces, camera, SIZE, float(skin.vertices[:, 2].min()), COARSE)
