"""What contact costs and leaves behind: smoothly skinned templates moved out of the body, frame by frame.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/contact.py [--clips walk dance some.bvh]

Per clip and template it prints milliseconds per frame (refit, queries and passes over the edges: the least,
the median, and the median processor time of all threads), the median in units of posing the body, the
percentage of vertices inside the body before and after, the percentage squeezed between its parts, the
deepest vertex elsewhere, the mean change of edge length against rest before and after, and the longest edge
in rest lengths afterwards.
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
from uvcloth.garments.templates import TEMPLATES, fit_template
from uvcloth.geometry.mesh import unique_edges
from uvcloth.geometry.skinning import skin
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import builtin_clips, load_clip
from uvcloth.physics.contact import Obstacle
from uvcloth.physics.measures import edge_change

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
    "squeezed %",
    "edge mm",
    "after",
)


def main(clips: tuple[str, ...] = ()) -> None:
    body = load_body()
    garments = [fit_template(name, body) for name in TEMPLATES]
    table = Table(*COLUMNS, "deepest mm", "longest x")
    for name in track(clips or tuple(builtin_clips()), description="contact"):
        clip = load_clip(name, body)
        for garment in garments:
            table.add_row(clip.name, garment.name, *measure(clip, garment, body))
    Console().print(table)


def measure(clip: Clip, garment: Garment, body: Body) -> list[str]:
    obstacle = Obstacle(make_collider(body), body.mesh.vertices)
    rest, faces = garment.mesh.vertices, garment.mesh.faces
    dressed = obstacle.contact_garment(rest, faces)
    before = None
    edges = unique_edges(faces)
    length = (rest[edges[:, 0]] - rest[edges[:, 1]]).norm(dim=1)
    rows = []
    for transforms in clip.transforms():
        pose = time.perf_counter()
        posed = skin(body.mesh.vertices, body.weights, transforms[None])[0]
        pose = time.perf_counter() - pose
        vertices = skin(rest, garment.smooth_weights, transforms[None])[0]
        wall, processor = time.perf_counter(), time.process_time()
        obstacle.update(posed)
        resolved, contacts = obstacle.resolve(vertices, dressed, before)
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
        before = resolved - vertices
        after = (resolved[edges[:, 0]] - resolved[edges[:, 1]]).norm(dim=1)
        rows.append(
            [
                1e3 * wall,
                1e3 * processor,
                1e3 * pose,
                100 * contacts.inside_before / len(vertices),
                100 * contacts.inside_after / len(vertices),
                100 * contacts.squeezed / len(vertices),
                1e3 * float(edge_change(vertices, rest, faces)),
                1e3 * float(edge_change(resolved, rest, faces)),
                1e3 * contacts.deepest,
                float((after / length).max()),
            ]
        )
    values = torch.tensor(rows)
    mean, most = values.mean(0), values.amax(0)
    return [
        f"{len(rest)}",
        f"{values[:, 0].min():.1f}",
        f"{values[:, 0].median():.1f}",
        f"{values[:, 1].median():.1f}",
        f"{values[:, 0].median() / values[:, 2].median():.1f}",
        *(f"{mean[column]:.2f}" for column in range(3, 8)),
        f"{most[8]:.2f}",
        f"{most[9]:.2f}",
    ]


if __name__ == "__main__":
    tyro.cli(main)
