"""DeePSD: its cost beside plain skinning, its independence of resolution, its blend weights, its tables.

Run from the checkout with PYTHONPATH=. as

    OMP_NUM_THREADS=1 python benchmarks/deepsd.py [--run RUN] [--garment FILE] [--reports DIR ...]

Without a run the network is untrained: times are the same, distances are those of chance.
"""

import colorsys
import json
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch
import tyro
from rich.console import Console
from rich.table import Table
from torch import Tensor

from benchmarks.timing import fastest
from evaluate.report import METRICS
from evaluate.standings import cells, garments_in, mean_of
from uvcloth.bodies.body import load_body
from uvcloth.bodies.frames import body_frames, with_lead
from uvcloth.errors import InputError
from uvcloth.files.image import write_png
from uvcloth.garments.fit import make_fitted
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.mesh import Mesh, join_meshes
from uvcloth.geometry.subdivide import halve_edges
from uvcloth.methods.deepsd.config import DeePSDConfig
from uvcloth.methods.deepsd.method import DeePSD
from uvcloth.methods.lbs import LBSConfig, SkinnedGarment, create_lbs
from uvcloth.methods.method import Method
from uvcloth.methods.registry import load_method
from uvcloth.motion.library import load_clip
from uvcloth.physics.surface import BodySurface
from uvcloth.rendering.render import BODY_COLOR, Surface, contact_sheet, render, three_quarter

CPU = torch.device("cpu")
VERTICES = 3000
"""Of the outfit that is timed: the first so many of the coarsest mesh that has them."""

BATCHES = (1, 64)
MOST_VERTICES = 20_000
"""Up to which every edge of a mesh is halved, once for each level of resolution."""

EVERY = 8
"""Frames of a clip from one that is compared to the next."""

FAR = 0.999
"""Share of the points that are less far from each other than "99.9 %" says."""

DISTANCES = ("mean", f"{100 * FAR:.1f} %", "most")

MEASURES = {
    "error, mm": "vertex_mean_mm",
    "edge, mm": "edge_mm",
    "bend, 1 - cos": "bend_cos",
    "inside, %": "inside_percent",
}
"""Columns of the tables: keys of metrics.json, before contact."""

PRINTED = {
    "without physics (Table 3)": (24.66, 1.27, 0.031, 11.59),
    "with physics": (33.75, 1.13, 0.029, 1.29),
    "with physics, poses anew": (34.45, 1.12, 0.029, 1.02),
    "skinning alone (Table 6)": (36.73, 1.16, 0.015, 15.4),
    "skinning alone, with physics": (37.67, 1.17, 0.013, 12.9),
}
"""The paper's rows, on CLOTH3D."""

PRINTED_TYPES = {
    "T-shirt": 25.77,
    "top": 17.33,
    "trousers": 14.50,
    "jumpsuit": 17.23,
    "skirt": 41.15,
    "dress": 35.94,
}
"""The paper's Table 4, mm, on CLOTH3D."""


SATURATION, VALUE = 0.75, 0.9
GOLDEN = 0.381966
"""Turn of the hue from one joint to the next: neighbours differ."""

PICTURE_SIZE = (300, 560)


@dataclass(frozen=True)
class DeepSDBenchmark:
    """Measure DeePSD."""

    run: Path | None = None
    """A folder written by `uvcloth train deepsd`."""
    garment: str = "tops"
    """A template or a garment file; one of about 1,000 vertices gives three levels of resolution."""
    body: Path | None = None
    """A body made by `uvcloth body`, on which it lies."""
    clip: str = "walk"
    """The motion."""
    rounds: int = 20
    """Of each timing; the fastest counts."""
    picture: Path | None = None
    """A PNG of the blend weights to draw."""
    reports: tuple[Path, ...] = ()
    """Folders written by `uvcloth evaluate`, whose methods go into the tables."""


def levels_of(mesh: Mesh) -> list[Mesh]:
    """A surface at several resolutions, the coarsest first: every edge halved from one to the next."""
    levels = [mesh]
    while True:
        vertices, faces = halve_edges(levels[-1].vertices, levels[-1].faces)
        if len(vertices) > MOST_VERTICES:
            return levels
        levels.append(Mesh(vertices, faces, torch.zeros(0, 2), faces[:0]))


def speed(method: DeePSD, outfit: Outfit, transforms: Tensor, rounds: int) -> Table:
    """CPU milliseconds per sample of VERTICES vertices, compared with linear blend skinning."""
    ready = method.prepare(outfit, CPU)
    if len(ready.points) < VERTICES:
        raise InputError(f"{outfit.garments[0].name}: has {len(ready.points)} vertices, {VERTICES} are timed")
    rig = replace(
        ready,
        owner=torch.arange(VERTICES),
        points=ready.points[:VERTICES],
        weights=ready.weights[:VERTICES],
        shapes=None if ready.shapes is None else ready.shapes[..., :VERTICES].contiguous(),
        sizes=(VERTICES,),
    )
    skinning, skinned = create_lbs(LBSConfig()), (SkinnedGarment(rig.points, rig.weights),)
    table = Table(f"{VERTICES} vertices", "DeePSD, ms a sample", "LBS, ms a sample", "ratio")
    for batch in BATCHES:
        frames = body_frames(outfit.body, with_lead(transforms[:batch]), 30.0)
        steps = (partial(method.step, rig, (), frames), partial(skinning.step, skinned, (), frames))
        cost, plain = (1e3 * fastest(step, rounds, time.thread_time) / batch for step in steps)
        table.add_row(f"batches of {batch}", f"{cost:.3f}", f"{plain:.3f}", f"{cost / plain:.1f}")
    return table


def resolution(method: Method, outfits: Sequence[Outfit], transforms: Tensor) -> Table:
    """Distances between what the method makes of one surface at several resolutions, coarsest first.

    What it makes of a coarse mesh is halved at its edges as the mesh was, so that points correspond. How far
    its surface is from the fine one is told besides.
    """
    table = Table(method.name, "against", *(f"{name}, mm" for name in DISTANCES), "surface, mean", "most")
    made: list[tuple[int, Tensor, Tensor]] = []
    for outfit in outfits:
        mesh = outfit.garments[0].mesh
        frames = body_frames(outfit.body, with_lead(transforms), 30.0)
        _, (vertices,) = method.step(method.prepare(outfit, CPU), (), frames)
        for count, coarse, faces in made:
            same = 1e3 * (_halved_until(coarse, faces, vertices.shape[1]) - vertices).norm(dim=-1)
            off = 1e3 * torch.stack(
                [
                    BodySurface(pose, faces).closest(points).signed_distance.abs()
                    for pose, points in zip(coarse, vertices, strict=True)
                ]
            )
            far = same.flatten().sort().values[int(FAR * same.numel())]
            distances = (same.mean(), far, same.max(), off.mean(), off.max())
            table.add_row(f"{len(mesh.vertices)}", f"{count}", *(f"{each:.2f}" for each in distances))
        made.append((len(mesh.vertices), vertices, mesh.faces))
    return table


def _halved_until(vertices: Tensor, faces: Tensor, count: int) -> Tensor:
    """Vertices (B, N, 3) and the middles of all edges, again and again until there are `count`."""
    batch, flat = len(vertices), vertices.transpose(0, 1).flatten(1)
    while len(flat) < count:
        flat, faces = halve_edges(flat, faces)
    return flat.view(-1, batch, 3).transpose(0, 1)


def tables(reports: Sequence[Path]) -> list[Table]:
    """Error, edges, bending and vertices inside of every method in some reports, and the error by type."""
    judged = [
        (f"{report.name}: {name}", results, method)
        for report in reports
        for results in [json.loads((report / METRICS).read_text(encoding="utf-8"))]
        for name, method in results["methods"].items()
    ]
    whole = Table("before contact, all garments", *MEASURES)
    for name, results, method in judged:
        found = [cell for garment in garments_in(results) for cell in cells(method, garment).values()]
        whole.add_row(name, *(_number(mean_of(found, f"{key}_raw")) for key in MEASURES.values()))
    for name, row in PRINTED.items():
        whole.add_row(f"paper, CLOTH3D: {name}", *map(_number, row))
    types = dict.fromkeys(kind for _, results, _ in judged for kind in garments_in(results))
    by_type = Table("error before contact, mm", *types)
    for name, _, method in judged:
        errors = (mean_of(cells(method, kind).values(), "vertex_mean_mm_raw") for kind in types)
        by_type.add_row(name, *map(_number, errors))
    by_type.add_row("paper, CLOTH3D (Table 4)", *(_number(PRINTED_TYPES.get(kind)) for kind in types))
    return [whole, by_type]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}" if value < 1 else f"{value:.2f}"


def draw_weights(method: DeePSD, outfit: Outfit, path: Path) -> None:
    """Write a PNG of blend weights, a colour per joint: the body's, the outfit's smooth and learned ones.

    From in front, and from behind.
    """
    body, prepared = outfit.body, method.prepare(outfit, CPU)
    hues = (torch.arange(len(body.skeleton.names)) * GOLDEN) % 1.0
    colors = torch.tensor([colorsys.hsv_to_rgb(hue, SATURATION, VALUE) for hue in hues.tolist()])
    joined = join_meshes((garment.mesh.vertices, garment.mesh.faces) for garment in outfit.garments)
    smooth = torch.cat([garment.smooth_weights for garment in outfit.garments])
    skin = Surface(body.mesh.vertices, body.mesh.faces, body.weights @ colors)
    bare = replace(skin, color=BODY_COLOR)
    columns = [[skin]] + [
        [bare, Surface(joined.vertices, joined.faces, weights @ colors)]
        for weights in (smooth, prepared.weights[prepared.owner])
    ]
    floor = float(body.mesh.vertices[:, 2].min())
    images = [
        render(
            surfaces,
            three_quarter(body.mesh.vertices, turn, aspect=PICTURE_SIZE[0] / PICTURE_SIZE[1]),
            PICTURE_SIZE,
            floor,
        )
        for turn in (20.0, 200.0)
        for surfaces in columns
    ]
    write_png(path, contact_sheet(images, len(columns)))


def main(options: DeepSDBenchmark) -> None:
    torch.set_num_threads(1)
    body, console = load_body(options.body), Console()
    method = load_method(options.run, body) if options.run else DeePSD.untrained(DeePSDConfig())
    if not isinstance(method, DeePSD):
        raise InputError(f"{options.run}: a model of another method, expected one of deepsd")
    transforms = load_clip(options.clip, body).transforms()
    coarsest = load_garment(options.garment, body)
    outfits = [
        Outfit(body, (make_fitted(coarsest.name, mesh, body, coarsest.template)[0],))
        for mesh in levels_of(coarsest.mesh)
    ]
    timed = next(each for each in outfits if len(each.garments[0].mesh.vertices) >= VERTICES)
    console.print(speed(method, timed, transforms, options.rounds))
    for each in (method, create_lbs(LBSConfig(smooth=True))):
        console.print(resolution(each, outfits, transforms[::EVERY]))
    if options.picture:
        draw_weights(method, outfits[0], options.picture)
    for table in tables(options.reports) if options.reports else ():
        console.print(table)
    load = ", ".join(f"{each:.1f}" for each in os.getloadavg())
    console.print(f"processor time of one thread; load of the machine {load} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main(tyro.cli(DeepSDBenchmark))
