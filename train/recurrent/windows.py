"""Windows of cage runs as a network learns them: the body's motion, and weights of shapes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import torch
from torch import Tensor

from rasterize.gather import gather
from rasterize.raycast import closest_points
from uvcloth.bodies.body import Body, load_body
from uvcloth.errors import InputError
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.mesh import welded
from uvcloth.geometry.mirror import mirror_transforms
from uvcloth.methods.recurrent.body_motion import body_motion
from uvcloth.methods.recurrent.network import RecurrentNetwork

from .cage_runs import VALIDATION, CageRun, load_run, reference_cage, run_files
from .motions import FPS

FITTED = 3
"""One of so many frames is fitted to."""

LEAST_SPREAD = 0.01
"""Least standard deviation that a motion is divided by: a joint that never moves is not noise."""

SAME = 1e-4
"""Standard deviation of a condition below which it is always the same."""

SKIN_EVERY = 4
"""One of so many frames of a window has its skin: the planes are most of the data."""

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
class RunStatistics:
    """Statistics of runs.

    center, spread: (C,) of the body's motion. usual, scale: (S,) of the condition, see
    RecurrentNetwork. mean: (n, 3) m, of the cage at rest. shapes: (K, n, 3) m,
    orthogonal, all of one length; of the first the weights have variance one.
    """

    center: Tensor
    spread: Tensor
    usual: Tensor
    scale: Tensor
    mean: Tensor
    shapes: Tensor

    @classmethod
    def of(cls, network: RecurrentNetwork) -> "RunStatistics":
        """The statistics that a network was trained with."""
        return cls(**{field.name: getattr(network, field.name) for field in fields(cls)})

    def to(self, device: torch.device) -> "RunStatistics":
        """The statistics on a device."""
        return RunStatistics(**{name: value.to(device) for name, value in vars(self).items()})

    def unit(self) -> float:
        """Root mean square over the vertices, m, of the offset that a weight of one makes."""
        return float(self.shapes[0].square().sum(1).mean().sqrt())

    def inside(self, weights: Tensor, skin: Tensor, margin: float) -> Tensor:
        """Metres (..., n) that points with weights (..., K) lack to be `margin` off the skin (..., n, 4)."""
        resting = self.mean + (weights @ self.shapes.flatten(1)).unflatten(-1, self.mean.shape)
        return (margin - (skin[..., :3] * resting).sum(-1) + skin[..., 3]).clamp(min=0.0)

    def weights(self, resting: Tensor) -> Tensor:
        """Weights (T, K) of the shapes in offsets at rest (T, n, 3), m."""
        shapes = self.shapes.flatten(1)
        return (resting - self.mean).flatten(1) @ shapes.T / shapes[0].square().sum()


@dataclass(frozen=True)
class Learned:
    """Frames as a network learns them.

    inputs: normalized motion (T, C). weights: (T, K). conditions: (T, S). skin: (T, n, 4) half, see CageRun.
    """

    inputs: Tensor
    weights: Tensor
    conditions: Tensor
    skin: Tensor


class GarmentRuns:
    """Runs of one garment's cage, on a device; more may come while they are used."""

    def __init__(
        self,
        folder: Path,
        body: Body,
        windows: Windows,
        shapes: int,
        device: torch.device,
        fitted: Mapping[str, RunStatistics],
    ) -> None:
        """Take in the runs of a folder; fits shapes to them unless the garment's statistics are given."""
        self.folder, self.body, self.windows, self.device = folder, body, windows, device
        files = run_files(folder)
        if not files or not run_files(folder / VALIDATION):
            raise InputError(f"{folder}: has no runs of a cage, or none of validation clips")
        first = load_run(files[0])
        self.name, self.quality = first.garment, first.quality
        garment = load_garment(self.name, load_body())
        mesh = welded(garment.mesh.vertices, garment.mesh.faces)
        cage = reference_cage(self.name, self.quality)
        self.corners, self.shares = cage.own_corners[mesh.places], cage.own_weights[mesh.places]
        across = closest_points(_across(cage.vertices), cage.vertices, cage.faces)
        self._opposite = cage.faces[across.face].to(device), across.barycentrics.to(device)
        self._mirrors = windows.mirror and float(across.distance.max()) < SYMMETRIC
        self._validation: dict[Path, CageRun] = {}
        given = fitted.get(self.name)
        self.restore(self._fit(files, shapes) if given is None else given)

    def _forget(self) -> None:
        self.frames = 0
        self._known: set[Path] = set()
        self._clips: dict[str, str] = {}
        self._runs: list[Learned] = []
        self._starts = torch.zeros(0, dtype=torch.int64, device=self.device)

    def __len__(self) -> int:
        """Number of places where a window may start."""
        return len(self._starts)

    def take_in(self) -> None:
        """Read the runs that came since."""
        new = [path for path in run_files(self.folder) if path not in self._known]
        for run in map(self._loaded, new):
            self._clips[run.clip] = run.subject
            self.frames += len(run)
            self._runs += map(self._learned, self._with_mirror_image(run))
        self._known |= set(new)
        lengths = torch.tensor([len(run.inputs) for run in self._runs])
        windows = lengths - self.windows.length + 1
        first = torch.repeat_interleave(lengths.cumsum(0) - lengths - (windows.cumsum(0) - windows), windows)
        self._starts = (torch.arange(len(first)) + first).to(self.device)
        self._all = Learned(
            **{
                name: torch.cat([getattr(run, name) for run in self._runs])
                for name in ("inputs", "weights", "conditions", "skin")
            }
        )

    def draw(self, places: Tensor) -> Learned:
        """Windows that start at places (B,), 0 to 1 in all runs: (B, W, ...), with conditions (B, S).

        Of the skin there is one frame in SKIN_EVERY, from the first that is scored on.
        """
        starts = self._starts[(places * len(self._starts)).long().clamp(max=len(self._starts) - 1)]
        rows = starts[:, None] + torch.arange(self.windows.length, device=self.device)
        some = self._all
        skin = some.skin[rows[:, self.windows.unscored :: SKIN_EVERY]]
        return Learned(some.inputs[rows], some.weights[rows], some.conditions[starts], skin)

    def extremes(self) -> Tensor:
        """Weights (2 K, K) of the frames in which each of them is the least or the greatest."""
        weights = self._all.weights
        return weights[torch.cat([weights.argmin(0), weights.argmax(0)])]

    def restore(self, fitted: RunStatistics) -> None:
        """Take the runs in again, with other statistics."""
        self.fitted = fitted.to(self.device)
        self._forget()
        self.take_in()

    def held_out(self) -> Iterator[CageRun]:
        """Yield the runs of validation clips."""
        for path in run_files(self.folder / VALIDATION):
            if path not in self._validation:
                self._validation[path] = self._loaded(path)
            yield self._validation[path]

    def clips(self, held_out: bool) -> dict[str, str]:
        """Subjects of the clips of the runs, by clip."""
        return {run.clip: run.subject for run in self.held_out()} if held_out else self._clips

    def inputs(self, run: CageRun, still: int = 0) -> Tensor:
        """Normalized motion (still + T, C) of a run, after `still` frames in which the body stands."""
        return (_motion(run, still) - self.fitted.center) / self.fitted.spread

    def _fit(self, files: Sequence[Path], count: int) -> RunStatistics:
        motions, resting, conditions = [], [], []
        for run in map(self._loaded, files):
            for each in self._with_mirror_image(run):
                motions.append(_motion(each)[::FITTED])
                resting.append(each.resting[::FITTED].flatten(1))
                conditions.append(each.condition)
        motion, offsets, condition = torch.cat(motions), torch.cat(resting), torch.stack(conditions)
        mean = offsets.mean(0)
        strengths, directions = torch.linalg.eigh((offsets - mean).T @ (offsets - mean) / len(offsets))
        shapes = directions[:, -count:].flip(1).T * strengths[-1].sqrt()
        apart = condition.std(0, correction=0)
        return RunStatistics(
            center=motion.mean(0),
            spread=motion.std(0).clamp(min=LEAST_SPREAD),
            usual=condition.mean(0),
            scale=torch.where(apart > SAME, 1.0 / apart.clamp(min=SAME), 0.0),
            mean=mean.view(-1, 3),
            shapes=shapes.reshape(len(shapes), -1, 3),
        )

    def _loaded(self, path: Path) -> CageRun:
        return load_run(path).to(self.device)

    def _with_mirror_image(self, run: CageRun) -> Iterator[CageRun]:
        yield run
        if self._mirrors:
            yield replace(
                run,
                transforms=mirror_transforms(run.transforms, self.body.skeleton),
                resting=_across(gather(run.resting, *self._opposite)),
                skin=_across(gather(run.skin, *self._opposite)),
            )

    def _learned(self, run: CageRun) -> Learned:
        """A run after a body that stands still, so that no window is too short."""
        still = max(self.windows.unscored, self.windows.length - len(run))
        weights = self.fitted.weights(run.resting)
        weights = torch.cat([weights[:1].expand(still, -1), weights])
        skin = torch.cat([run.skin[:1].expand(still, -1, -1), run.skin]).half()
        return Learned(self.inputs(run, still), weights, run.condition.expand(len(weights), -1), skin)


def _motion(run: CageRun, still: int = 0) -> Tensor:
    """Body motion (still + T, C), after `still` frames in which the body stands."""
    led = torch.cat([run.transforms[:1].expand(still + 2, -1, -1, -1), run.transforms])
    return body_motion(led.unfold(0, 3, 1).movedim(-1, 1), run.heads, FPS)


def _across(points: Tensor) -> Tensor:
    """Points (..., 3) or planes (..., 4) mirrored across x = 0."""
    return points * points.new_tensor([-1.0, 1.0, 1.0, 1.0])[: points.shape[-1]]
