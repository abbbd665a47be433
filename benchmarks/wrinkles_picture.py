"""Wrinkles of networks under a raking light, between the fine cloth that they were trained on and none.

    python benchmarks/wrinkles_picture.py DATA RUN ... --out wrinkles.png

Rows: tracking cloth, networks, cages with the edges of --cages, m, the smooth surface of the cage; each is
cleared from the skin. Columns: a moment of each run of the split, by default the one with the largest true
folds, half of them from behind.
"""

import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import torch
import tyro
from wrinkles import caged

import uvcloth.rendering.render as studio
from train.wrinkles.frames import FineTexels, run_files, run_frames
from train.wrinkles.tracked_runs import LED_IN, load_run
from uvcloth.bodies.body import load_body
from uvcloth.bodies.posing import posed_skin
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.physics.outfit_clearing import OutfitClearing
from uvcloth.process.command import run_command
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS, Surface, contact_sheet, render, three_quarter
from uvcloth.wrinkles.model import load_wrinkles
from uvcloth.wrinkles.outfit import WrinkledOutfit
from uvcloth.wrinkles.sheet import Sheet

RAKING = np.array([-1.0, 0.05, 0.35], np.float32)
"""Towards the light: left of the camera, hardly above."""


@torch.no_grad()
def main(
    data: tyro.conf.Positional[Path],
    models: tyro.conf.Positional[tuple[Path, ...]],
    out: Path,
    split: str = "test",
    at: int | None = None,
    cages: tuple[float, ...] = (),
    garment: str = "tops",
    size: tuple[int, int] = (300, 330),
) -> None:
    """Draw the picture."""
    torch.set_num_threads(1)
    studio.KEY_DIRECTION = RAKING
    body = load_body()
    template = load_garment(garment, body)
    sheet = Sheet.of(template, 128)
    mesh = sheet.refined.mesh
    clearing = OutfitClearing.of(body, [mesh])
    places = FineTexels(template, sheet)
    outfit, loaded = Outfit(body, (template,)), [load_wrinkles(folder) for folder in models]
    networks = [WrinkledOutfit(each, outfit, [template.mesh], each.config.quality) for each in loaded]
    rows: list[list[np.ndarray]] = [[] for _ in range(len(networks) + 2 + len(cages))]
    for column, path in enumerate(run_files([data], split)):
        run = load_run(path)
        _, truth, axes = run_frames(sheet, body, run, places.offsets(run, path))
        frame = int(truth.square().mean((1, 2, 3)).argmax()) if at is None else at
        posed, smooth = posed_skin(body, run.transforms), sheet.refined.at(run.coarse[frame + 2])
        shown = [smooth + sheet.at_vertices(axes[frame] @ truth[frame])]
        for wrinkled in networks:
            wrinkled.begin()
            for now in range(max(0, frame - LED_IN), frame + 1):
                (made,) = wrinkled.shown((run.coarse[now + 2],), posed[now], run.fps)
            shown.append(made)
        for edge in cages:
            moved = caged(template, body, run.transforms, run.fps, edge)
            shown.append(sheet.refined.at(moved[frame]))
        for row, vertices in zip(rows, (*shown, smooth), strict=True):
            (cleared,) = clearing.cleared([vertices], posed[frame])
            camera = three_quarter(cleared, turn=35.0 if column % 2 == 0 else 215.0, aspect=size[0] / size[1])
            surfaces = [
                Surface(posed[frame], body.mesh.faces, BODY_COLOR),
                Surface(cleared, mesh.faces, GARMENT_COLORS[1]),
            ]
            row.append(render(surfaces, camera, size))
    iio.imwrite(out, contact_sheet([image for row in rows for image in row], len(rows[0])))


if __name__ == "__main__":
    sys.exit(run_command("wrinkles_picture.py", lambda: tyro.cli(main)))
