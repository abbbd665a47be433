"""Description of a garment file and of how it lies on the body, as text and as a picture."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.bodies.visible import visible_body
from uvcloth.commands.fit import Fit
from uvcloth.errors import InputError
from uvcloth.files.image import write_png
from uvcloth.garments.alignment import Known
from uvcloth.garments.band import held_by
from uvcloth.garments.fit import Fitting, fit
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.judge import UnwearableError
from uvcloth.garments.pieces import split
from uvcloth.garments.places import places
from uvcloth.garments.templates import TEMPLATES
from uvcloth.geometry.mesh import Mesh
from uvcloth.methods.registry import DEFAULT
from uvcloth.motion.library import load_clip
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS, Surface, contact_sheet, render, three_quarter
from uvcloth.rollouts.ready import ready_method, ready_rollout
from uvcloth.writers.obj import save_obj

TURNS = (20.0, 110.0, 200.0)
"""Degrees around the body of the three views: front, side and back."""

MOTION, MOMENTS = "dance", (7, 14, 28)
"""Built-in clip in which the cloth solver moves garments, and its frames that are shown, at 30 a second."""

SIZE = (300, 440)
"""Width and height of a view in pixels."""


def run(command: Fit) -> None:
    """Print the description and write the files. Raises InputError for bad input."""
    print("\n".join(examine(command)))


def examine(command: Fit) -> list[str]:
    """Fit a garment file to a body and describe it, line by line.

    Writes the OBJ of the garment as it is worn, one for each of several, and the PNG of it on the body: at
    rest, also where it is refused for how it lies, and as the cloth solver moves it in MOTION.
    Raises InputError as `fit` does.
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
        _write_picture(picture, [_worn([error.mesh], body)])
        raise InputError(f"{error} ({picture} shows it)") from error
    lines = fitted.diagnosis.lines()
    garments: tuple[Garment, ...] = (fitted.garment,)
    if fitted.diagnosis.components > 1:
        garments = split(fitted.garment.name, fitted.garment.mesh, body, template)
    if len(garments) > 1:
        lines[-1] = f"  {len(garments)} garments, the innermost first (rollout moves each by itself):"
        lines += [f"    {garment.name}, worn as {garment.template}" for garment in garments]
    lines += [_held(garment, body) for garment in garments]
    if command.out is not None:
        lines += [str(path) for path in _write(garments, fitted.garment.name, command.out)]
    if picture is not None:
        rows = [_worn([garment.mesh for garment in garments], body)]
        try:
            rows.append(list(_moving(garments, body)))
        except InputError as error:
            lines.append(f"  not shown as cloth: {error}")
        _write_picture(picture, rows)
        lines.append(str(picture))
    return lines


def _held(garment: Garment, body: Body) -> str:
    """A line on the places that hold a garment up, and those that --hold can name."""
    try:
        where = held_by(garment, body)
    except InputError as error:
        return f"  {error}"
    others = [place for place in places(garment.mesh, body) if place not in where]
    more = f"; it also has {', '.join(others)} (--hold)" if others else ""
    return f"  {garment.name}: held up by its {' and '.join(where)}{more}"


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


def _worn(garments: Sequence[Mesh], body: Body) -> list[np.ndarray]:
    """Pictures of garments on a body at rest, from the front, the side and the back."""
    shown = visible_body(body).mesh
    return [_view(shown, [(mesh, mesh.vertices) for mesh in garments], turn) for turn in TURNS]


def _moving(garments: Sequence[Garment], body: Body) -> Iterator[np.ndarray]:
    """Pictures of garments as cloth at MOMENTS. Raises InputError if the solver cannot move them."""
    outfit, shown = Outfit(body, tuple(garments)), visible_body(body)
    method, clear = ready_method([DEFAULT], outfit, None, "fast", ())
    ready = ready_rollout(method, outfit, load_clip(MOTION, body).window(0, MOMENTS[-1] + 1), clear)
    for frame in ready.frames():
        if frame.index in MOMENTS:
            skin = replace(shown.mesh, vertices=posed_skin(shown, frame.transforms[None])[0])
            yield _view(skin, list(zip(ready.proxied.meshes, frame.vertices, strict=True)), TURNS[0])


def _view(skin: Mesh, garments: Sequence[tuple[Mesh, Tensor]], turn: float) -> np.ndarray:
    """Picture of a posed body in garments at (N, 3) m each, from degrees around it."""
    surfaces = [
        Surface(skin.vertices, skin.faces, BODY_COLOR),
        *(
            Surface(vertices, mesh.faces, GARMENT_COLORS[index % len(GARMENT_COLORS)])
            for index, (mesh, vertices) in enumerate(garments)
        ),
    ]
    everything = torch.cat([surface.vertices for surface in surfaces])
    camera = three_quarter(everything, turn, aspect=SIZE[0] / SIZE[1])
    return render(surfaces, camera, SIZE, float(everything[:, 2].min()))


def _write_picture(path: Path, rows: Sequence[Sequence[np.ndarray]]) -> None:
    """Write a PNG of rows of pictures.

    Raises InputError for another suffix than .png, or if the file cannot be written.
    """
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: a picture is written as .png, not {path.suffix or 'without a suffix'}")
    write_png(path, contact_sheet([picture for row in rows for picture in row], len(rows[0])))
