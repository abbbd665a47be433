"""What contact costs and leaves behind: smoothly skinned templates moved out of the body, frame by frame.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/contact.py [--clips walk dance some.bvh] [--every 5]

Per clip and template it prints milliseconds per frame (refit, queries and smoothing: the least, the median,
and the median processor time of all threads), the median in units of posing the body, the percentage of
vertices inside the body before and after, the percentage left calm in its self-intersections, the deepest
vertex elsewhere, and by how much resolving lengthens an edge at most, against its length before or at rest,
whichever is greater.
"""

import time

import torch
import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table

from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.collider import make_collider
from uvcloth.garments.garment import Garment
from uvcloth.garments.templates import TEMPLATES, wear
from uvcloth.mesh import unique_edges
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import builtin_clips, load_clip
from uvcloth.physics.contact import BodySurface, Smoother, inside_share, resolve
from uvcloth.skinning import skin

COLUMNS = (
    "clip",
    "template",
    "vertices",
    "ms min",
    "median",
    "cpu",
    "x pose",
    "inside %",
    "after %",
    "calm %",
)


def main(clips: tuple[str, ...] = (), every: int = 5) -> None:
    body = load_body()
    garments = [wear(name, body) for name in TEMPLATES]
    table = Table(*COLUMNS, "deepest mm", "longer x")
    for name in track(clips or tuple(builtin_clips()), description="contact"):
        clip = load_clip(name, body)
        for garment in garments:
            table.add_row(clip.name, garment.name, *measure(clip, garment, body, every))
    Console().print(table)


def measure(clip: Clip, garment: Garment, body: Body, every: int) -> list[str]:
    collider = make_collider(body)
    surface = BodySurface(collider.vertices(body.mesh.vertices), collider.faces)
    smoother = Smoother(garment.mesh.vertices, garment.mesh.faces)
    edges = unique_edges(garment.mesh.faces)
    rows = []
    for transforms in clip.transforms()[::every]:
        pose = time.perf_counter()
        posed = collider.vertices(skin(body.mesh.vertices, body.weights, transforms[None])[0])
        pose = time.perf_counter() - pose
        vertices = skin(garment.mesh.vertices, garment.carrier_weights, transforms[None])[0]
        wall, processor = time.perf_counter(), time.process_time()
        surface.update(posed)
        resolved, contacts = resolve(vertices, surface, smoother)
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        rest, before, after = (
            (points[edges[:, 0]] - points[edges[:, 1]]).norm(dim=1)
            for points in (garment.mesh.vertices, vertices, resolved)
        )
        rows.append(
            [
                1e3 * wall,
                1e3 * processor,
                1e3 * pose,
                inside_share(vertices, surface)[1],
                inside_share(resolved, surface)[1],
                100 * contacts.in_conflict / len(vertices),
                1e3 * contacts.deepest,
                float((after / torch.maximum(before, rest)).max()),
            ]
        )
    values = torch.tensor(rows)
    mean, most = values.mean(0), values.amax(0)
    return [
        f"{len(garment.mesh.vertices)}",
        f"{values[:, 0].min():.1f}",
        f"{values[:, 0].median():.1f}",
        f"{values[:, 1].median():.1f}",
        f"{values[:, 0].median() / values[:, 2].median():.1f}",
        *(f"{mean[column]:.2f}" for column in (3, 4, 5)),
        f"{most[6]:.2f}",
        f"{most[7]:.2f}",
    ]


if __name__ == "__main__":
    tyro.cli(main)
