"""What opening the collider costs, and what it leaves of the overlap of the body's parts.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/opened.py [--clips walk 08_02] [--bodies benchmarks/bodies/tall/bodies/tall.npz]

on one thread. Names that are no clips of the package are sought below the folder that UVCLOTH_MOCAP names
(without it ../shared/mocap); without captures, the package's clips are taken. Per body and clip it prints
processor milliseconds a frame, the longest way that a vertex is moved, and before and after how deep the
deepest vertex of one part is below the skin of another that mocap presses it into, and how many are in a
frame, in every tenth frame, for each kind of pair. Caps do not count: what is in them is where a limb begins.
"""

import os
import time
from pathlib import Path

import torch
import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table
from torch import Tensor

from uvcloth.bodies.body import Body, load_body
from uvcloth.bodies.collider import Collider, make_collider
from uvcloth.bodies.opened import make_opening
from uvcloth.bodies.posing import posed_skin
from uvcloth.motion.library import builtin_clips, load_clip
from uvcloth.physics.surface import BodySurface

MOCAP = Path(os.environ.get("UVCLOTH_MOCAP", Path(__file__).parents[2] / "shared" / "mocap"))

CAPTURES = ("08_02", "16_11", "16_17", "14_14", "13_29", "49_11")
"""Clips in which arms, thighs and calves are pressed into other parts."""

EVERY = 10
"""Of so many frames one is looked at for what overlaps."""

KINDS = {"arm, ribs": (0, 1), "thigh, belly": (2, 3), "thighs": (4,), "calf, thigh": (5, 6)}
"""Pairs of Collider.pressed by what they are."""


def main(clips: tuple[str, ...] = (), bodies: tuple[Path, ...] = ()) -> None:
    torch.set_num_threads(1)
    found = {path.stem: path for path in MOCAP.rglob("*.bvh")} if MOCAP.is_dir() else {}
    chosen = clips or tuple(name for name in CAPTURES if name in found) or tuple(builtin_clips())
    table = Table(
        "body", "clip", "frames", "ms", "moved mm", *(f"{kind}: deepest mm, inside" for kind in KINDS)
    )
    for path in (None, *bodies):
        body = load_body(path)
        for name in track(chosen, description=body.name):
            table.add_row(body.name, name, *measure(str(found.get(name, name)), body))
    Console(width=200).print(table)


def measure(clip: str, body: Body) -> list[str]:
    collider = make_collider(body)
    opening = make_opening(collider, body.mesh.vertices)
    posed = collider.vertices(posed_skin(body, load_clip(clip, body).transforms()))
    opening.opened(posed[:1])
    start = time.process_time()
    opened = opening.opened(posed)
    spent = time.process_time() - start
    before, after = (
        overlaps(frames[::EVERY], collider, len(body.mesh.vertices)) for frames in (posed, opened)
    )
    return [
        f"{len(posed)}",
        f"{1e3 * spent / len(posed):.2f}",
        f"{1e3 * float((opened - posed).norm(dim=-1).max()):.0f}",
        *(
            f"{was[0]:.0f} > {left[0]:.0f}, {was[1]:.1f} > {left[1]:.1f}"
            for was, left in zip(before, after, strict=True)
        ),
    ]


def overlaps(frames: Tensor, collider: Collider, count: int) -> list[tuple[float, float]]:
    """Of each kind of pair how deep a vertex is in the other part, mm, and how many are inside in a frame."""
    surfaces = [BodySurface(frames[0], part) if len(part) else None for part in collider.parts]
    own = [part[(part < count).all(1)].unique() for part in collider.parts]
    depths: list[list[Tensor]] = [[] for _ in KINDS]
    for frame in frames:
        for kind, pairs in zip(depths, KINDS.values(), strict=True):
            found = []
            for pair in pairs:
                for part, other in (collider.pressed[pair], collider.pressed[pair][::-1]):
                    surface = surfaces[other]
                    if surface is None or not len(own[part]):
                        continue
                    surface.update(frame)
                    rows = own[part][~torch.isin(own[part], own[other])]
                    closest = surface.closest(frame[rows])
                    skin = (collider.parts[other] < count).all(1)[closest.faces]
                    found.append(torch.where(skin, -closest.signed_distance, 0.0))
            kind.append(torch.cat(found))
    return [
        (
            1e3 * max(float(each.max()) for each in kind),
            sum(int((each > 0).sum()) for each in kind) / len(frames),
        )
        for kind in depths
    ]


if __name__ == "__main__":
    tyro.cli(main)
