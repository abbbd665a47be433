"""Description of a garment file and of how it lies on the body, as text and as a picture."""

from pathlib import Path

import torch

from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.visible import visible_body
from uvcloth.commands.fit import Fit
from uvcloth.errors import InputError
from uvcloth.export.obj import save_obj
from uvcloth.files.image import write_png
from uvcloth.garments.alignment import Known
from uvcloth.garments.fit import Fitting, fit
from uvcloth.garments.garment import Garment
from uvcloth.garments.judge import UnwearableError
from uvcloth.garments.pieces import split
from uvcloth.garments.templates import TEMPLATES
from uvcloth.geometry.mesh import Mesh
from uvcloth.render import BODY_COLOR, GARMENT_COLORS, Surface, contact_sheet, render, three_quarter

TURNS = (20.0, 110.0, 200.0)
"""Degrees around the body of the three views: front, side and back."""

SIZE = (300, 440)
"""Width and height of a view in pixels."""


def examine(command: Fit) -> list[str]:
    """Fit a garment file to a body and describe it, line by line.

    Writes the OBJ of the garment as it is worn, one for each of several, and the PNG of it on the body, also
    where it is refused for how it lies. Raises InputError as `fit` does.
    """
    file, template, picture = command.file, command.template, command.picture
    if str(file) in TEMPLATES:
        raise InputError(f"{file}: is a template, which fits every body; expected a garment file")
    body = load_body(command.body)
    try:
        known = Known(command.shift, command.scale, command.turn)
        fitted = fit(file, body, template, Fitting(command.garment_pose, known, command.from_body))
    except UnwearableError as error:
        if picture is None:
            raise
        draw_worn([error.mesh], body, picture)
        raise InputError(f"{error} ({picture} shows it)") from error
    lines = fitted.diagnosis.lines()
    garments: tuple[Garment, ...] = (fitted.garment,)
    if fitted.diagnosis.components > 1:
        garments = split(fitted.garment.name, fitted.garment.mesh, body, template)
    if len(garments) > 1:
        lines[-1] = f"  {len(garments)} garments, the innermost first (rollout moves each by itself):"
        lines += [f"    {garment.name}, worn as {garment.template}" for garment in garments]
    if command.out is not None:
        lines += [str(path) for path in _write(garments, fitted.garment.name, command.out)]
    if picture is not None:
        draw_worn([garment.mesh for garment in garments], body, picture)
        lines.append(str(picture))
    return lines


def _write(garments: tuple[Garment, ...], name: str, out: Path) -> list[Path]:
    """Write garments of a file of that name into OBJ files of their own: OUT.obj, OUT-tops.obj, ..."""
    paths = [
        out
        if len(garments) == 1
        else out.with_stem(f"{out.stem}-{garment.name.removeprefix(name + '_').replace('_', '-')}")
        for garment in garments
    ]
    for garment, path in zip(garments, paths, strict=True):
        save_obj(garment.mesh, path)
    return paths


def draw_worn(garments: list[Mesh], body: Body, path: Path) -> None:
    """Write a PNG of garments on a body at rest from the front, the side and the back.

    Raises InputError for another suffix than .png, or if the file cannot be written.
    """
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: a picture is written as .png, not {path.suffix or 'without a suffix'}")
    shown = visible_body(body).mesh
    skin = Surface(shown.vertices, shown.faces, BODY_COLOR)
    surfaces = [
        skin,
        *(
            Surface(mesh.vertices, mesh.faces, GARMENT_COLORS[index % len(GARMENT_COLORS)])
            for index, mesh in enumerate(garments)
        ),
    ]
    everything = torch.cat([surface.vertices for surface in surfaces])
    floor = float(everything[:, 2].min())
    views = [
        render(surfaces, three_quarter(everything, turn, aspect=SIZE[0] / SIZE[1]), SIZE, floor)
        for turn in TURNS
    ]
    write_png(path, contact_sheet(views, len(views)))
