"""Frames of tracking cloth as inputs and displacements at the texels of a garment's sheet."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from rich.progress import track
from torch import Tensor

from rasterize.gather import gather
from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.physics.surface import BodySurface, closest_points
from uvcloth.wrinkles.inputs import FARTHEST, first_past, texel_inputs
from uvcloth.wrinkles.sheet import Sheet

from .tracked_runs import TrackedRun, fine_mesh, fine_mesh_name, load_run


@dataclass(frozen=True)
class TexelFrames:
    """Frames of runs, one after another.

    inputs: (R, P, CHANNELS) half. wrinkles: (R, P, 3, 4) half, m, displacements along u, v and the normal at
    the quarters of texels. later: (R,) bool, frames with one before them in their run.
    """

    inputs: Tensor
    wrinkles: Tensor
    later: Tensor


def run_files(folders: Sequence[Path], split: str) -> list[Path]:
    """Files of the runs of a split."""
    return [path for folder in folders for path in sorted((folder / split).glob("*.npz"))]


class FineTexels:
    """Places of the quarters of a sheet's texels in the fine meshes of folders of runs."""

    def __init__(self, garment: Garment, sheet: Sheet) -> None:
        self.garment, self.sheet = garment, sheet
        self._known: dict[Path, tuple[str, Tensor, Tensor]] = {}

    def offsets(self, run: TrackedRun, path: Path) -> Tensor:
        """Offsets (T, P, 4, 3) m of a run at the quarters. Raises InputError for one of another fine mesh."""
        folder = path.parents[1]
        if folder not in self._known:
            fine, _ = fine_mesh(self.garment, folder, None)
            near = closest_points(self.sheet.quarters.flatten(0, 1), fine.rest, fine.faces)
            self._known[folder] = fine_mesh_name(fine), fine.faces[near.face], near.barycentrics
        name, corners, shares = self._known[folder]
        if run.mesh != name or run.garment != self.garment.name:
            raise InputError(f"{path}: is not of the fine mesh of {self.garment.name} in {folder}")
        return gather(run.offsets, corners, shares).unflatten(1, (-1, 4))


@torch.no_grad()
def run_frames(sheet: Sheet, body: Body, run: TrackedRun, offsets: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Inputs (T, P, CHANNELS), displacements (T, P, 3, 4) m and axes (T, P, 3, 3) at the texels of a run.

    offsets: (T, P, 4, 3) m in the world.
    """
    points = run.coarse[:, sheet.refined.kept]
    skin = BodySurface(body.mesh.vertices, body.mesh.faces)
    posed = posed_skin(body, run.transforms)
    skin.update(posed[0])
    past = first_past(sheet, points[0])
    _, _, past = texel_inputs(
        sheet, points[1], past, run.fps, skin.closest(points[1], FARTHEST).signed_distance
    )
    inputs, axes_of = [], []
    for index in range(len(run)):
        skin.update(posed[index])
        away = skin.closest(points[index + 2], FARTHEST).signed_distance
        rows, axes, past = texel_inputs(sheet, points[index + 2], past, run.fps, away)
        inputs.append(rows)
        axes_of.append(axes)
    turned = torch.stack(axes_of)
    return torch.stack(inputs), (offsets @ turned).transpose(2, 3), turned


def load_frames(
    files: Sequence[Path], garment: Garment, body: Body, sheet: Sheet
) -> tuple[TexelFrames, dict[str, str]]:
    """Read runs; also the person of each clip."""
    places = FineTexels(garment, sheet)
    inputs, wrinkles, later, clips = [], [], [], {}
    for path in track(files, "runs", transient=True):
        run = load_run(path)
        rows, displacements, _ = run_frames(sheet, body, run, places.offsets(run, path))
        inputs.append(rows.half())
        wrinkles.append(displacements.half())
        later.append(torch.arange(len(run)) > 0)
        clips[run.clip] = run.subject
    return TexelFrames(torch.cat(inputs), torch.cat(wrinkles), torch.cat(later)), clips
