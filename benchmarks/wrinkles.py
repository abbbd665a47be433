"""Wrinkles beside what rivals make of the same smooth surface, against fine cloth that tracks it.

    python benchmarks/wrinkles.py DATA --models RUN ...

DATA: made by `train.wrinkles.tracked_runs`. Rivals are fitted to its training runs, and their settings are
chosen on validation. Scores: those of `evaluate.folds`, on frames that are FIRST or more from their run's
start.

plain: the smooth surface. table: the true folds of another moment of training. sharpened: the cloth's offset
from the skinned garment without its long waves, times a factor. pooled, local: ridge regression of the
displacement on the inputs of the same texel, one for all texels, one for each. global: of all texels on
principal components of all inputs. NAME x GAIN: as it is shown, with its lag, smoothed, and the gain by
which waves of 20 to 80 mm get their true size on validation. cage: the same motion on cages with shorter
edges. --unseen FOLDER: runs of the garment that the networks were trained on, if it is another one; the
network, and linear maps of that garment's texels, see the closest places of the judged garment, on their own
axes, and there are no wrinkles more than UNSERVED away from it.
"""

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
import torch
import tyro
from rich.console import Console
from scipy.spatial import KDTree
from torch import Tensor

from evaluate.folds import FoldFilters, FoldLooks, band_energies, fold_filters, fold_looks, fold_scores
from rasterize.gather import gather
from train.wrinkles.frames import FineTexels, load_frames, run_files, run_frames
from train.wrinkles.tracked_runs import coarse_garment, load_run
from uvcloth.bodies.body import Body, load_body
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Garment
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.mesh import neighbour_average
from uvcloth.geometry.skinning import skin
from uvcloth.physics.surface import closest_points
from uvcloth.process.command import run_command
from uvcloth.wrinkles.inputs import input_maps
from uvcloth.wrinkles.model import Wrinkles, load_wrinkles
from uvcloth.wrinkles.sheet import Sheet, right_angled

FIRST = 15
"""Frames of a run that are not scored: a finer cage starts from rest in its first pose."""

EVERY = 9
"""One of so many frames is scored by its shape; all of them by their change."""

SCORED = slice(FIRST, None, EVERY)
"""Frames of a run that are scored by their shape."""

COLUMNS = ("40-80", "20-40", "10-20", "cosine", "signed", "places", "popping", "motion", "mm")
"""Heads of the table's columns."""

RIDGES = (1e-2, 1e-1, 1.0)
"""Shares of the mean variance of inputs that ridges may be."""

KEPT = (16, 64, 192)
"""Numbers of principal components that may be kept."""

MOVING = [*range(12), *range(15, 19)]
"""Input channels that change over a run."""


@dataclass(frozen=True)
class Judged:
    """A run with what is needed to judge displacements on it.

    fps: of the run. inputs: (T, P, CHANNELS). axes: (T, P, 3, 3). truth: (T, P, 3, 4) m on these axes, at the
    quarters of texels. smooth: (T, n, 3) m of the refined mesh. sharp: (T, n, 3) m, see the module. finer:
    (T, n, 3) m, offset of a finer cage. looks: of the true folds in the frames that are scored by them.
    """

    fps: float
    inputs: Tensor
    axes: Tensor
    truth: Tensor
    smooth: Tensor
    sharp: Tensor
    finer: Mapping[float, Tensor]
    looks: FoldLooks


UNSERVED = 0.02
"""Metres from a garment that a network was trained on, beyond which it has nothing to lend."""

Maker = Callable[[Judged], Tensor]
"""Displacements (T, P, 3, 4) m on the axes of texels, or (T, n, 3) m of the refined mesh in the world."""


def judged(
    path: Path,
    garment: Garment,
    body: Body,
    sheet: Sheet,
    places: FineTexels,
    filters: FoldFilters,
    edges: Sequence[float],
) -> Judged:
    """Read a run, and make what rivals need of it."""
    run = load_run(path)
    offsets = places.offsets(run, path)
    inputs, truth, axes = run_frames(sheet, body, run, offsets)
    coarse = run.coarse[2:]
    skinned = skin(garment.mesh.vertices, garment.smooth_weights, run.transforms)
    away = sheet.refined.at(coarse - skinned)
    finer = {
        edge: sheet.refined.at(caged(garment, body, run.transforms, run.fps, edge) - coarse) for edge in edges
    }
    smooth = sheet.refined.at(coarse)
    return Judged(
        run.fps,
        inputs,
        axes,
        truth,
        smooth,
        away - filters.passes[0](away).float(),
        finer,
        fold_looks(filters, smooth[SCORED].double(), sheet.at_vertices((axes @ truth)[SCORED])),
    )


def caged(garment: Garment, body: Body, transforms: Tensor, fps: float, edge: float) -> Tensor:
    """The garment (T, N, 3) m on a cage with edges of a length, m."""
    name = f"{1000 * edge:.0f} mm"
    QUALITIES[name] = edge
    return coarse_garment(garment, body, transforms.double(), fps, name)


def in_world(sheet: Sheet, run: Judged, made: Tensor) -> Tensor:
    """Displacements (T, n, 3) m of the refined mesh in the world, of those at quarters on texels' axes."""
    return made if made.dim() == 3 else sheet.at_vertices(run.axes @ made)


def score(sheet: Sheet, filters: FoldFilters, runs: Sequence[Judged], make: Maker) -> dict[str, float]:
    """Scores of a maker over runs."""
    parts: dict[str, list[Tensor]] = {}
    wrong = changed = moved = error = size = 0.0
    for run in runs:
        made = make(run)
        looks = fold_looks(filters, run.smooth[SCORED].double(), in_world(sheet, run, made)[SCORED])
        scores = fold_scores(filters, looks, run.looks)
        scores |= {"made_mm2": looks.energies, "real_mm2": run.looks.energies}
        for name, values in scores.items():
            parts.setdefault(name, []).append(values)
        local = made if made.dim() == 4 else quarter_values(sheet, run, made)
        change, true = local[FIRST:].diff(dim=0), run.truth[FIRST:].diff(dim=0)
        wrong += float((change - true).double().square().sum())
        moved += float(change.double().square().sum())
        changed += float(true.double().square().sum())
        error += float((local - run.truth)[FIRST:].double().norm(dim=2).mean()) * 1000.0
        size += 1
    all_of = {name: torch.cat(values) for name, values in parts.items()}
    ratio = (all_of["made_mm2"].mean(0) / all_of["real_mm2"].mean(0)).sqrt()
    return {
        "40-80": float(ratio[0]),
        "20-40": float(ratio[1]),
        "10-20": float(ratio[2]),
        "cosine": float(all_of["cosine"].mean()),
        "signed": float(all_of["signed"].mean()),
        "places": float(all_of["places"].mean()),
        "popping": (wrong / changed) ** 0.5,
        "motion": (moved / changed) ** 0.5,
        "mm": error / size,
    }


def quarter_values(sheet: Sheet, run: Judged, made: Tensor) -> Tensor:
    """Displacements (T, P, 3, 4) m at quarters on texels' axes, of those (T, n, 3) of the refined mesh."""
    mesh = sheet.refined.mesh
    near = closest_points(sheet.quarters.flatten(0, 1), mesh.vertices, mesh.faces)
    world = gather(made.float(), mesh.faces[near.face], near.barycentrics).unflatten(1, (-1, 4))
    return (world @ run.axes).transpose(2, 3)


def fit_pooled(inputs: Tensor, wrinkles: Tensor, ridge: float) -> Maker:
    """One ridge regression for all texels, with their mean displacement. inputs: (R, P, C) half."""
    count = len(inputs)
    mean = wrinkles.float().mean(0)
    scale = inputs[::16].float().std((0, 1)).clamp(min=1e-4)
    gram, cross = torch.zeros(len(MOVING) + 1, len(MOVING) + 1), torch.zeros(len(MOVING) + 1, 12)
    for rows in torch.arange(0, count, 4).split(32):
        x = with_one(inputs[rows].float()[..., MOVING] / scale[MOVING]).flatten(0, 1)
        gram += x.T @ x / len(x)
        cross += x.T @ (wrinkles[rows].float() - mean).flatten(2).flatten(0, 1) / len(x)
    solved = torch.linalg.solve(gram + ridge * torch.eye(len(gram)), cross)
    return lambda run: (
        (with_one(run.inputs[..., MOVING] / scale[MOVING]) @ solved).unflatten(2, (3, 4)) + mean
    )


def fit_local(inputs: Tensor, wrinkles: Tensor, ridges: Sequence[float]) -> list[Maker]:
    """A ridge regression for each texel, on the inputs there, for each of the ridges."""
    scale = inputs[::16].float().std((0, 1)).clamp(min=1e-4)[MOVING]
    size = len(MOVING) + 1
    solved: list[list[Tensor]] = [[] for _ in ridges]
    for texels in torch.arange(inputs.shape[1]).split(512):
        x = with_one(inputs[:, texels].float()[..., MOVING] / scale).transpose(0, 1)
        y = wrinkles[:, texels].float().flatten(2).transpose(0, 1)
        gram, cross = x.mT @ x / len(inputs), x.mT @ y / len(inputs)
        free = torch.eye(size)
        free[-1, -1] = 1e-6
        for ridge, parts in zip(ridges, solved, strict=True):
            parts.append(torch.linalg.solve(gram + ridge * free, cross))
    weights = [torch.cat(parts) for parts in solved]

    def maker(each: Tensor) -> Maker:
        def make(run: Judged) -> Tensor:
            rows = torch.einsum("tpc,pcd->tpd", with_one(run.inputs[..., MOVING] / scale), each)
            return rows.unflatten(2, (3, 4))

        return make

    return [maker(each) for each in weights]


def fit_global(inputs: Tensor, wrinkles: Tensor, kept: Sequence[int], ridge: float) -> list[Maker]:
    """Ridge regressions of all displacements on the first principal components of all inputs."""
    count, texels, _ = inputs.shape
    some = torch.arange(0, texels, 5)
    scale = inputs[::16].float().std((0, 1)).clamp(min=1e-4)[MOVING]
    x = (inputs[:, some].float()[..., MOVING] / scale).flatten(1)
    middle = x.mean(0)
    x -= middle
    values, vectors = torch.linalg.eigh(x @ x.T)
    most = max(kept)
    lengths = values[-most:].flip(0).clamp(min=1e-6).sqrt()
    scores = vectors[:, -most:].flip(1) * lengths
    directions = (x.T @ vectors[:, -most:].flip(1)) / lengths
    y = wrinkles.float().flatten(1)
    mean = y.mean(0)
    weights = [
        torch.linalg.solve(
            scores[:, :k].T @ scores[:, :k] + ridge * lengths[0] ** 2 / count * torch.eye(k),
            scores[:, :k].T @ (y - mean),
        )
        for k in kept
    ]

    def maker(k: int, each: Tensor) -> Maker:
        def make(run: Judged) -> Tensor:
            values = (run.inputs[:, some][..., MOVING] / scale).flatten(1) - middle
            return (values @ directions[:, :k] @ each + mean).view(len(run.inputs), texels, 3, 4)

        return make

    return [maker(k, each) for k, each in zip(kept, weights, strict=True)]


def with_one(values: Tensor) -> Tensor:
    """Values (..., C + 1) with a channel of ones."""
    return torch.cat([values, torch.ones_like(values[..., :1])], dim=-1)


def network(wrinkles: Wrinkles, sheet: Sheet) -> Maker:
    """The maker of a trained network, without its lag and its gain."""

    def make(run: Judged) -> Tensor:
        maps = torch.cat([wrinkles.net(input_maps(sheet, rows)) for rows in run.inputs.split(8)])
        return maps.flatten(2)[:, :, sheet.texels.pixels].transpose(1, 2).unflatten(2, (3, 4))

    return make


@dataclass(frozen=True)
class WrinklesBenchmark:
    """Judge wrinkles and their rivals."""

    data: tyro.conf.Positional[Path]
    """Folder of runs."""
    models: tuple[Path, ...] = ()
    """Runs of `uvcloth train wrinkles`."""
    splits: tuple[Literal["validation", "test"], ...] = ("validation",)
    """Splits that are scored; settings are chosen on validation."""
    rivals: bool = True
    """Fit the rivals, too."""
    garment: str = "tops"
    """Template that is judged."""
    cages: tuple[float, ...] = (0.030, 0.028, 0.026)
    """Edges of finer cages, m."""
    unseen: Path | None = None
    """Runs of the template that the models were trained on, if it is another one."""

    @torch.no_grad()
    def run(self) -> None:
        """Print the table."""
        torch.set_num_threads(1)
        body = load_body()
        garment = load_garment(self.garment, body)
        sheet = Sheet.of(garment, 128)
        filters = fold_filters(sheet.refined.mesh.vertices, sheet.refined.mesh.faces)
        places = FineTexels(garment, sheet)
        console = Console()
        held = {
            split: [
                judged(path, garment, body, sheet, places, filters, self.cages)
                for path in run_files([self.data], split)
            ]
            for split in dict.fromkeys(("validation", *self.splits))
        }

        def shown(name: str, make: Maker) -> None:
            for split in self.splits:
                scores = score(sheet, filters, held[split], make)
                figures = " | ".join(f"{value:.2f}" for value in scores.values())
                console.print(f"| {split} | {name} | {figures} |", soft_wrap=True)

        console.print(", ".join(f"{split}: {len(held[split])} runs" for split in self.splits))
        console.print(f"| | | {' | '.join(COLUMNS)} |", soft_wrap=True)
        for folder in self.models:
            wrinkles = load_wrinkles(folder)
            (trained,) = wrinkles.config.garments
            if trained == self.garment:
                make = network(wrinkles, sheet)
            else:
                other = Sheet.of(load_garment(trained, body), 128)
                make = borrowed(Closest.of(other, sheet), network(wrinkles, other))
            shown(folder.name, make)
            late = as_shown(sheet, make, wrinkles.config.lag)
            gain = gain_of(sheet, filters, held["validation"], late)
            shown(f"{folder.name} x {gain:.2f}", multiplied(gain, late))
        if not self.rivals:
            return
        shown("truth on maps", lambda run: run.truth)
        shown("plain", lambda run: torch.zeros_like(run.truth))
        for edge in self.cages:
            shown(f"cage of {1000 * edge:.0f} mm", on_cage(edge))
        strength = gain_of(sheet, filters, held["validation"], lambda run: run.sharp)
        shown(f"sharpened x {strength:.1f}", lambda run: strength * run.sharp)

        def best(names: Sequence[str], makers: Sequence[Maker]) -> tuple[str, Maker]:
            def signed(place: int) -> float:
                return score(sheet, filters, held["validation"], makers[place])["signed"]

            place = max(range(len(makers)), key=signed)
            return names[place], makers[place]

        if self.unseen:
            self.show_borrowed(sheet, body, best, shown)
        frames, _ = load_frames(run_files([self.data], "train"), garment, body, sheet)
        console.print(f"{len(frames.inputs)} training frames")
        inputs, table = frames.inputs, frames.wrinkles
        generator = np.random.default_rng(0)

        def other_moment(run: Judged) -> Tensor:
            return table[int(generator.integers(len(table) - len(run.truth))) :][: len(run.truth)].float()

        shown("table", other_moment)
        shown("mean of each texel", lambda run: table.float().mean(0).expand_as(run.truth))
        shown("pooled", fit_pooled(inputs, table, RIDGES[1]))
        shown(*best([f"local {ridge:g}" for ridge in RIDGES], fit_local(inputs, table, RIDGES)))
        shown(*best([f"global {count}" for count in KEPT], fit_global(inputs, table, KEPT, 1.0)))

    def show_borrowed(
        self,
        sheet: Sheet,
        body: Body,
        best: Callable[[Sequence[str], Sequence[Maker]], tuple[str, Maker]],
        shown: Callable[[str, Maker], None],
    ) -> None:
        """Fit means and linear maps to the other garment, and judge what this one borrows of them."""
        assert self.unseen is not None
        files = run_files([self.unseen], "train")
        other = load_garment(load_run(files[0]).garment, body)
        lent = Sheet.of(other, 128)
        closest, (frames, _) = Closest.of(lent, sheet), load_frames(files, other, body, lent)
        mean = frames.wrinkles.float().mean(0)
        shown("mean, unseen", borrowed(closest, lambda run: mean.expand(len(run.truth), -1, -1, -1)))
        makers = [borrowed(closest, make) for make in fit_local(frames.inputs, frames.wrinkles, RIDGES)]
        shown(*best([f"local {ridge:g}, unseen" for ridge in RIDGES], makers))


@dataclass(frozen=True)
class Closest:
    """The texels (P,) of a judged sheet that are closest to those (Q,) of another one, and the way back.

    sheet: the other one. texels: (Q,). turns: (Q, 2, 2) of directions along u and v there into those here.
    back: (P, 4) quarters, of 4 Q, closest to the quarters of the judged sheet. served: (P,) whether one is.
    """

    sheet: Sheet
    texels: Tensor
    turns: Tensor
    back: Tensor
    served: Tensor

    @classmethod
    def of(cls, sheet: Sheet, judged: Sheet) -> "Closest":
        """Find them by places at rest."""
        places = sheet.quarters[:, 0]
        texels = torch.from_numpy(KDTree(judged.quarters[:, 0]).query(places)[1])
        tangents, others = (each.forms(each.mesh.points)[1] for each in (sheet, judged))
        turns = right_angled(tangents.mT @ others[texels])
        away, back = KDTree(sheet.quarters.flatten(0, 1)).query(judged.quarters.flatten(0, 1))
        served = torch.from_numpy(away).unflatten(0, (-1, 4)).amin(1) < UNSERVED
        return cls(sheet, texels, turns, torch.from_numpy(back).unflatten(0, (-1, 4)), served)


def borrowed(closest: Closest, make: Maker) -> Maker:
    """What a maker of another garment makes of the closest places of a judged one."""
    turns, texels, back = closest.turns, closest.texels, closest.back

    def borrow(run: Judged) -> Tensor:
        rows = run.inputs[:, texels].clone()
        (a, b), (c, d) = (row.unbind(1) for row in turns.unbind(1))
        for k in range(0, 12, 3):
            uu, vv, uv = run.inputs[:, texels, k : k + 3].unbind(2)
            rows[..., k] = a * a * uu + b * b * vv + 2.0 * a * b * uv
            rows[..., k + 1] = c * c * uu + d * d * vv + 2.0 * c * d * uv
            rows[..., k + 2] = a * c * uu + b * d * vv + (a * d + b * c) * uv
        rows[..., 12:15] = closest.sheet.rest_bend
        rows[..., 15:17] = (turns @ rows[..., 15:17, None])[..., 0]
        rows[..., 19:22] = closest.sheet.quarters[:, 0]
        made = make(replace(run, inputs=rows))
        plane = turns.mT @ made[:, :, :2]
        quarters = torch.cat([plane, made[:, :, 2:]], dim=2).transpose(2, 3).flatten(1, 2)
        return (quarters[:, back] * closest.served[:, None, None]).transpose(2, 3)

    return borrow


def as_shown(sheet: Sheet, make: Maker, lag: float) -> Maker:
    """What is made, with a lag, s, and smoothed, as the runtime shows it but for its gain."""
    mesh = sheet.refined.mesh
    average = neighbour_average(mesh.faces, len(mesh.vertices)).float().to_sparse_csr()

    def shown(run: Judged) -> Tensor:
        frames = list(make(run))
        for before, now in pairwise(range(len(frames))):
            frames[now] = lagged(frames[before], frames[now], run.fps, lag)
        rough = in_world(sheet, run, torch.stack(frames)).transpose(0, 1)
        smooth = (average @ rough.flatten(1)).view(rough.shape)
        return (0.5 * (rough + smooth)).transpose(0, 1)

    return shown


def lagged(before: Tensor, now: Tensor, fps: float, lag: float) -> Tensor:
    """Values that follow new ones, now, from those of the frame before with a lag, s."""
    return now if lag == 0.0 else now + math.exp(-1.0 / (fps * lag)) * (before - now)


def on_cage(edge: float) -> Maker:
    """What a finer cage makes."""
    return lambda run: run.finer[edge]


def multiplied(gain: float, make: Maker) -> Maker:
    """What is made, times a gain."""
    return lambda run: gain * make(run)


def gain_of(sheet: Sheet, filters: FoldFilters, runs: Sequence[Judged], make: Maker) -> float:
    """Factor by which the waves of 20 to 80 mm of what is made get their true size over runs."""
    worlds = (in_world(sheet, run, make(run))[SCORED] for run in runs)
    made = sum(float(band_energies(filters, world)[:, :2].sum()) for world in worlds)
    real = sum(float(run.looks.energies[:, :2].sum()) for run in runs)
    return float((real / made) ** 0.5)


if __name__ == "__main__":
    sys.exit(run_command("wrinkles.py", lambda: tyro.cli(WrinklesBenchmark).run()))
