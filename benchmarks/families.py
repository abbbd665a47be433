"""Garments in the conventions of seven families of bodies: each fitted, rolled out and judged by figures.

Run from the checkout with PYTHONPATH=. as

    OMP_NUM_THREADS=1 python benchmarks/families.py OUT [--only smpl vroid_gown]

The files are made up: random garments that are sewn on our bodies, stretched to the proportions of the family
and in its pose, unit, axes and origin (`tests/acceptance/families.py`). Each is written into OUT as OBJ,
placed as `uvcloth fit` places it, and moved by physics in two built-in clips. OUT/results.csv gets a row for
each, OUT/NAME.png its picture: as it was modelled, at rest on our body from the front and the back, and in
the frame of each clip where most skin shows. With --from-body it is transferred with its ease instead.
"""

import csv
import sys
import time
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path

import numpy as np
import torch
import tyro
from torch import Tensor

from tests.acceptance.families import FAMILIES, MadeUp, made_up, on_another_mesh, written
from uvcloth.bodies.body import Body, load_body
from uvcloth.errors import InputError
from uvcloth.files.image import write_png
from uvcloth.garments.fit import PLAIN, Fitting, fit
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.places import hems
from uvcloth.geometry.mesh import Mesh, boundary_edges, edge_lengths, unique_edges, weld
from uvcloth.lighting import COARSE
from uvcloth.methods.registry import DEFAULT
from uvcloth.motion.library import load_clip
from uvcloth.physics.exposure import Exposure
from uvcloth.physics.self_intersection import crossing_edges_percent
from uvcloth.physics.surface import BodySurface
from uvcloth.process.command import run_command
from uvcloth.ready import ready_method, ready_rollout
from uvcloth.render import BODY_COLOR, GARMENT_COLORS, Surface, contact_sheet, render, three_quarter

BODY = Path(__file__).parent / "bodies"

FILES = (
    *(("smpl", kind, "") for kind in ("tshirt", "longsleeve", "trousers", "shorts", "skirt", "gown")),
    *(("smpl_a", kind, "heavy") for kind in ("top", "jacket", "trousers", "jumpsuit")),
    *(("vroid", kind, "slim") for kind in ("tshirt", "longsleeve", "shorts", "skirt", "gown", "jacket")),
    *(("makehuman", kind, "muscular") for kind in ("tshirt", "jacket", "jumpsuit")),
    *(("mixamo", kind, "") for kind in ("longsleeve", "trousers", "top", "gown")),
    *(("readyplayer", kind, "") for kind in ("longsleeve", "trousers", "jacket")),
    *(("unreal", kind, "tall") for kind in ("tshirt", "trousers", "gown", "longsleeve")),
)
"""Family, kind of the garment, and the body of `benchmarks/bodies` that is stretched, "" for the default."""

CLIPS, FRAMES, EVERY = ("dance", "kick"), 60, 3
"""Clips, their frames at most, and the frames between two that are judged."""

SIZE = (270, 400)
"""Width and height of a view in pixels."""

NEAR = 0.1
"""Metres from the skin up to which cloth has an ease."""

LEAST_CORNERS = 8
"""Vertices of a hem that is no hole."""

HELD, WIDEST, MOST_UNEVEN = 0.7, 0.2, 0.4
"""Distance of a bone from the middle of a hem, in the hem's radii, up to which it goes through it; metres of
the radius up to which it is that of no skirt; and its depth over its radius up to which it is no open front.
"""


@dataclass(frozen=True)
class Row:
    """Figures of a file.

    vertices: of the garment. seconds: processor time of fitting. way: how it was placed. inside: percent of
    the vertices at rest. ease: median over that on the body that it was modelled on. eased: percent of the
    vertices whose ease is within 30 % of it. edges: percent within 10 % of their length, times one scale.
    skin, worst: percent of the covered skin that shows, over the frames on average, and at most. crossing:
    percent of the edges that run through cloth at most, and rest_crossing at rest. held: percent of the hems
    around limbs, neck and trunk that a bone goes through, over all frames. slip: cm that the middle of one
    moves along its bone at most.
    """

    name: str
    body: str
    vertices: int
    seconds: float = 0.0
    way: str = ""
    inside: float = 0.0
    ease: float = 0.0
    eased: float = 0.0
    edges: float = 0.0
    skin: float = 0.0
    worst: float = 0.0
    rest_crossing: float = 0.0
    crossing: float = 0.0
    held: float = 100.0
    slip: float = 0.0
    refused: str = ""


@dataclass(frozen=True)
class Families:
    """Fit made-up garments of other bodies, and judge them."""

    out: tyro.conf.Positional[Path]
    """Folder for files, pictures and results."""
    only: tuple[str, ...] = ()
    """Families, or FAMILY_KIND of files; all by default."""
    from_body: bool = False
    """Give the body that they were modelled on."""

    def run(self) -> None:
        """Write the results, and print them."""
        torch.set_num_threads(1)
        torch.set_grad_enabled(False)
        self.out.mkdir(parents=True, exist_ok=True)
        with (self.out / "results.csv").open("w", newline="") as stream:
            table = csv.writer(stream)
            table.writerow(field.name for field in fields(Row))
            stream.flush()
            for number, (family, kind, source) in enumerate(FILES):
                if self.only and not {family, f"{family}_{kind}"} & set(self.only):
                    continue
                row = self._judge(number, family, kind, source)
                table.writerow(astuple(row))
                stream.flush()
                print(*astuple(row), flush=True)

    def _judge(self, number: int, family: str, kind: str, source: str) -> Row:
        body = load_body()
        other = load_body(BODY / f"{source}.npz") if source else body
        made = made_up(family, kind, other, number)
        path = written(made.garment, self.out / f"{family}_{kind}.obj")
        row = Row(f"{family}_{kind}", source or "default", len(made.garment.vertices))
        how = PLAIN
        if self.from_body:
            how = Fitting(from_body=written(on_another_mesh(made.body), self.out / f"{path.stem}_body.obj"))
        axes = made.unit * torch.tensor(FAMILIES[family].axes)
        there, worn = (replace(mesh, vertices=mesh.vertices @ axes) for mesh in (made.body, made.garment))
        views = [view(there, worn)]
        begun = time.process_time()
        try:
            fitted = fit(path, body, how=how)
        except InputError as error:
            write_png(self.out / f"{path.stem}.png", contact_sheet(views, 1))
            return replace(row, refused=str(error).removeprefix(f"{path}: "))
        row = replace(row, seconds=round(time.process_time() - begun, 1), way=fitted.diagnosis.way[0])
        row = at_rest(row, made, fitted.garment.mesh, body)
        views += [view(body.mesh, fitted.garment.mesh, turn) for turn in (20.0, 200.0)]
        row, moving = rolled_out(row, fitted.garment, body)
        write_png(self.out / f"{path.stem}.png", contact_sheet([*views, *moving], 5))
        return row


def at_rest(row: Row, made: MadeUp, mesh: Mesh, body: Body) -> Row:
    """The row with the figures of a garment that lies on a body at rest."""
    joined = weld(made.garment.vertices)[made.garment.faces]
    edges = unique_edges(joined)
    ratio = edge_lengths(mesh.vertices, edges) / edge_lengths(made.garment.vertices * made.unit, edges)
    scale = float(ratio.median())
    before = (
        made.unit
        * scale
        * BodySurface(made.body.vertices, made.body.faces)
        .closest(made.garment.vertices, 2.0 / made.unit)
        .signed_distance
    )
    after = BodySurface(body.mesh.vertices, body.mesh.faces).closest(mesh.vertices, 2.0).signed_distance
    near = (before > 0) & (before < NEAR)
    crossing = crossing_edges_percent(mesh.vertices[None], weld(mesh.vertices)[mesh.faces])
    change = (after / before)[near]
    return replace(
        row,
        inside=percent(after < 0),
        ease=round(float(change.median()), 2),
        eased=percent((change - 1.0).abs() < 0.3),
        edges=percent((ratio / scale - 1.0).abs() < 0.1),
        rest_crossing=round(float(crossing[0]), 2),
    )


def percent(mask: Tensor) -> float:
    """Percent of a mask that is true."""
    return round(100.0 * float(mask.float().mean()), 1)


def rolled_out(row: Row, garment: Garment, body: Body) -> tuple[Row, list[np.ndarray]]:
    """The row with the figures of a garment in motion, and a picture of each clip's worst frame."""
    outfit = Outfit(body, (garment,))
    pictures: list[np.ndarray] = []
    exposure, rings = Exposure(body, [garment.mesh]), Rings(garment.mesh, body)
    faces = weld(garment.mesh.vertices)[garment.mesh.faces]
    skin, crossing, held, slips = [], [], [], []
    for clip in CLIPS:
        motion = load_clip(clip, body)
        method, clear = ready_method([DEFAULT], outfit, None, "fast", ())
        try:
            ready = ready_rollout(method, outfit, motion.window(0, min(FRAMES, len(motion))), clear)
        except InputError as error:
            return replace(row, refused=str(error)), pictures
        worst, shown = -1.0, None
        for frame in ready.frames(every=EVERY):
            posed, cloth = frame.body_vertices, frame.vertices[0]
            skin.append(exposure.percent([cloth], posed))
            crossing.append(float(crossing_edges_percent(cloth[None], faces)[0]))
            through, slip = rings.measured(cloth, frame.transforms)
            held.append(through)
            slips.append(slip)
            if skin[-1] > worst:
                worst = skin[-1]
                shown = replace(body.mesh, vertices=posed), replace(garment.mesh, vertices=cloth)
        assert shown is not None
        pictures.append(view(*shown))
    return replace(
        row,
        skin=round(sum(skin) / len(skin), 2),
        worst=round(max(skin), 2),
        crossing=round(max(crossing), 2),
        held=percent(torch.cat(held)),
        slip=round(100.0 * float(torch.cat(slips).amax()), 1) if len(torch.cat(slips)) else 0.0,
    ), pictures


class Rings:
    """Hems of a garment that go around a bone at rest."""

    def __init__(self, mesh: Mesh, body: Body) -> None:
        parents = body.skeleton.parents
        self._heads = body.skeleton.heads
        self._bones = torch.tensor([(parent, joint) for joint, parent in enumerate(parents) if parent >= 0])
        self._hems, self._bone = [], []
        loops = hems(boundary_edges(weld(mesh.vertices)[mesh.faces]))
        for hem in (loop for loop in loops if len(loop) >= LEAST_CORNERS):
            off, _ = self._off(mesh.vertices[hem], self._heads)
            away = mesh.vertices[hem] - mesh.vertices[hem].mean(0)
            radius = float(away.norm(dim=1).mean())
            depth = float(torch.linalg.svdvals(away)[-1]) / len(hem) ** 0.5
            if float(off.min()) < HELD and radius < WIDEST and depth < MOST_UNEVEN * radius:
                self._hems.append(hem)
                self._bone.append(int(off.argmin()))
        self._rest = [
            self._off(mesh.vertices[hem], self._heads)[1][bone]
            for hem, bone in zip(self._hems, self._bone, strict=True)
        ]

    def _off(self, hem: Tensor, heads: Tensor) -> tuple[Tensor, Tensor]:
        """Distances (B,) of bones from the middle of a hem, over its radius, and metres (B,) along them."""
        start, end = heads[self._bones].unbind(1)
        bone, middle = end - start, hem.mean(0)
        length = bone.norm(dim=1).clamp(min=1e-6)
        along = ((middle - start) * bone).sum(1) / length
        nearest = start + (along / length).clamp(0.0, 1.0)[:, None] * bone
        return (middle - nearest).norm(dim=1) / (hem - middle).norm(dim=1).mean(), along

    def measured(self, vertices: Tensor, transforms: Tensor) -> tuple[Tensor, Tensor]:
        """Mask (R,) of hems that their bone goes through, and metres (R,) that each moved along it."""
        heads = (transforms[..., :3].float() @ self._heads[:, :, None]).squeeze(-1) + transforms[
            ..., 3
        ].float()
        now = [
            [each[bone] for each in self._off(vertices[hem], heads)]
            for hem, bone in zip(self._hems, self._bone, strict=True)
        ]
        off = torch.tensor([float(each) for each, _ in now])
        slip = torch.tensor(
            [abs(float(each - rest)) for (_, each), rest in zip(now, self._rest, strict=True)]
        )
        return off < 1.0, slip


def view(body: Mesh, garment: Mesh, turn: float = 20.0) -> np.ndarray:
    """Picture of a body in a garment, from degrees around it."""
    surfaces: Sequence[Surface] = (
        Surface(body.vertices, body.faces, BODY_COLOR),
        Surface(garment.vertices, garment.faces, GARMENT_COLORS[0]),
    )
    camera = three_quarter(body.vertices, turn, aspect=SIZE[0] / SIZE[1])
    return render(surfaces, camera, SIZE, float(body.vertices[:, 2].min()), COARSE)


if __name__ == "__main__":
    sys.exit(run_command("families.py", lambda: tyro.cli(Families).run()))
