"""Windows of cage runs as a network learns them: the body's motion, and weights of shapes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from rasterize.gather import gather
from rasterize.raycast import closest_points
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.cage import QUALITIES, make_cage
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.mesh import welded
from uvcloth.geometry.mirror import mirror_transforms
from uvcloth.geometry.rotations import rotate
from uvcloth.geometry.skinning import blend_transforms
from uvcloth.methods.recurrent.body_motion import body_motion

from .cage_runs import VALIDATION, CageRun, load_run, run_files
from .motions import FPS

FLATTEST = 0.2
"""Least determinant of a blended transform that is inverted: between legs far apart they are nearly flat."""

FITTED = 3
"""One of so many frames is fitted to."""

LEAST_SPREAD = 0.01
"""Least standard deviation that an input is divided by: a joint that never moves is not noise."""

SYMMETRIC = 0.02
"""Metres that a cage's mirrored vertices may be off it: its faces are coarse, the garment is symmetric."""


@dataclass(frozen=True)
class Windows:
    """Windows of the runs.

    length: frames. unscored: the first of them, and how long the body stands before a run. mirror: whether
    runs of symmetric garments have mirror images as well.
    """

    length: int
    unscored: int
    mirror: bool


@dataclass(frozen=True)
class Fitted:
    """Statistics of runs.

    center, spread: (C,) of the body's motion. mean: (n, 3) m, of the cage at rest. shapes: (K, n, 3) m,
    orthogonal, all of one length; of the first the weights have variance one.
    """

    center: Tensor
    spread: Tensor
    mean: Tensor
    shapes: Tensor

    @property
    def unit(self) -> float:
        """Root mean square over the vertices, m, of the offset that a weight of one makes."""
        return float(self.shapes[0].square().sum(1).mean().sqrt())

    def weights(self, resting: Tensor) -> Tensor:
        """Weights (T, K) of the shapes in offsets at rest (T, n, 3), m."""
        shapes = self.shapes.flatten(1)
        return (resting - self.mean).flatten(1) @ shapes.T / shapes[0].square().sum()


@dataclass(frozen=True)
class Learned:
    """A run as a network learns it: normalized motion (T, C), weights (T, K)."""

    inputs: Tensor
    weights: Tensor


class GarmentRuns:
    """Runs of one garment's cage; more may come while they are used."""

    def __init__(self, folder: Path, body: Body, windows: Windows, shapes: int) -> None:
        self.folder, self.body, self.windows = folder, body, windows
        files = run_files(folder)
        if not files or not run_files(folder / VALIDATION):
            raise InputError(f"{folder}: has no runs of a cage, or none of validation clips")
        first = load_run(files[0])
        self.name, self.quality = first.garment, first.quality
        garment = load_garment(self.name, body)
        mesh = welded(garment.mesh.vertices, garment.mesh.faces)
        self.cage = make_cage(mesh.points, mesh.faces, QUALITIES[self.quality])
        self.blend = self.cage.at_cage(garment.smooth_weights[mesh.kept])
        self.corners, self.shares = self.cage.own_corners[mesh.places], self.cage.own_weights[mesh.places]
        across = closest_points(_across(self.cage.vertices), self.cage.vertices, self.cage.faces)
        self._opposite = self.cage.faces[across.face], across.barycentrics
        self._mirrors = windows.mirror and float(across.distance.max()) < SYMMETRIC
        self.fitted = self._fit(files, shapes)
        self._forget()

    def _forget(self) -> None:
        self.frames = 0
        self._end = 0
        self._known: set[Path] = set()
        self._clips: dict[str, str] = {}
        self._runs: list[Learned] = []
        self._starts = torch.zeros(0, dtype=torch.int64)

    def __len__(self) -> int:
        """Number of places where a window may start."""
        return len(self._starts)

    def take_in(self) -> None:
        """Read the runs that came since."""
        new = [path for path in run_files(self.folder) if path not in self._known]
        for run in map(load_run, new):
            self._clips[run.clip] = run.subject
            self.frames += len(run.offsets)
            for each in self._with_mirror_image(run):
                learned = self._learned(each)
                last = len(learned.inputs) - self.windows.length
                self._starts = torch.cat([self._starts, self._end + torch.arange(last + 1)])
                self._end += len(learned.inputs)
                self._runs.append(learned)
        self._known |= set(new)
        self._all = Learned(
            torch.cat([run.inputs for run in self._runs]), torch.cat([run.weights for run in self._runs])
        )

    def draw(self, places: Tensor) -> tuple[Tensor, Tensor]:
        """Windows that start at places (B,), 0 to 1 in all runs: inputs (B, W, C), weights (B, W, K)."""
        starts = self._starts[(places * len(self._starts)).long().clamp(max=len(self._starts) - 1)]
        rows = starts[:, None] + torch.arange(self.windows.length)
        return self._all.inputs[rows], self._all.weights[rows]

    def extremes(self) -> Tensor:
        """Weights (2 K, K) of the frames in which each of them is the least or the greatest."""
        weights = self._all.weights
        return weights[torch.cat([weights.argmin(0), weights.argmax(0)])]

    def restore(self, fitted: Fitted) -> None:
        """Take the runs in again, with other statistics."""
        self.fitted = fitted
        self._forget()
        self.take_in()

    def held_out(self) -> Iterator[CageRun]:
        """Yield the runs of validation clips."""
        yield from map(load_run, run_files(self.folder / VALIDATION))

    def clips(self, held_out: bool) -> dict[str, str]:
        """Subjects of the clips of the runs, by clip."""
        return {run.clip: run.subject for run in self.held_out()} if held_out else self._clips

    def posed(self, resting: Tensor, transforms: Tensor) -> Tensor:
        """Offsets at rest (T, n, 3), m, as the skinned cage turns them. transforms: (T, J, 3, 4)."""
        return rotate(blend_transforms(self.blend, transforms)[..., :3], resting)

    def _fit(self, files: Sequence[Path], count: int) -> Fitted:
        motions, resting = [], []
        for run in map(load_run, files):
            for each in self._with_mirror_image(run):
                motions.append(self._motion(each)[::FITTED])
                some = replace(each, transforms=each.transforms[::FITTED], offsets=each.offsets[::FITTED])
                resting.append(self._resting(some).flatten(1))
        motion, offsets = torch.cat(motions), torch.cat(resting)
        mean = offsets.mean(0)
        strengths, directions = torch.linalg.eigh((offsets - mean).T @ (offsets - mean) / len(offsets))
        shapes = directions[:, -count:].flip(1).T * strengths[-1].sqrt()
        return Fitted(
            center=motion.mean(0),
            spread=motion.std(0).clamp(min=LEAST_SPREAD),
            mean=mean.view(-1, 3),
            shapes=shapes.reshape(len(shapes), -1, 3),
        )

    def _with_mirror_image(self, run: CageRun) -> Iterator[CageRun]:
        yield run
        if self._mirrors:
            yield replace(
                run,
                transforms=mirror_transforms(run.transforms, self.body.skeleton),
                offsets=_across(gather(run.offsets, *self._opposite)),
            )

    def _learned(self, run: CageRun) -> Learned:
        """A run after a body that stands still, so that no window is too short."""
        still = max(self.windows.unscored, self.windows.length - len(run.offsets))
        weights = self.fitted.weights(self._resting(run))
        return Learned(self.inputs(run, still), torch.cat([weights[:1].expand(still, -1), weights]))

    def inputs(self, run: CageRun, still: int = 0) -> Tensor:
        """Normalized motion (still + T, C) of a run, after `still` frames in which the body stands."""
        return (self._motion(run, still) - self.fitted.center) / self.fitted.spread

    def _motion(self, run: CageRun, still: int = 0) -> Tensor:
        """Body motion (still + T, C), after `still` frames in which the body stands."""
        led = torch.cat([run.transforms[:1].expand(still + 2, -1, -1, -1), run.transforms])
        return body_motion(led.unfold(0, 3, 1).movedim(-1, 1), self.body.skeleton.heads, FPS)

    def _resting(self, run: CageRun) -> Tensor:
        """Offsets (T, n, 3) m before skinning turns them, the least ones where it is nearly flat."""
        first, second, third = blend_transforms(self.blend, run.transforms)[..., :3].unbind(-1)
        cross = torch.linalg.cross
        rows = torch.stack([cross(second, third), cross(third, first), cross(first, second)], dim=-2)
        volume = (first * rows[..., 0, :]).sum(-1, keepdim=True)
        return rotate(rows, run.offsets) / volume.clamp(min=FLATTEST)


def _across(points: Tensor) -> Tensor:
    """Points (..., 3) mirrored across x = 0."""
    return points * points.new_tensor([-1.0, 1.0, 1.0])
