"""The training data of Motion-guided: one garment on one body, frame after frame, clip after clip."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import torch
from rich.console import Console
from torch import Tensor

from uvcloth.dataset.bodies import folder_body
from uvcloth.dataset.clip import SimulatedClip, count_frames
from uvcloth.dataset.reader import read_clips, require_rests
from uvcloth.dataset.rows import Rows, joined_rows, joined_vertices, led_in
from uvcloth.dataset.splits import Holdout, hold_out, of_split, training_data
from uvcloth.errors import InputError
from uvcloth.garments.loading import load_garment_for_data
from uvcloth.geometry.mesh import edge_lengths, laplacian, unique_edges
from uvcloth.geometry.operators import Operator, differences, sampling
from uvcloth.geometry.records import CPU, to_device
from uvcloth.methods.motion_guided.config import MotionGuidedConfig
from uvcloth.methods.motion_guided.dynamics_input import MEMORY, Pose, local_offsets, shape_features
from uvcloth.methods.motion_guided.garment_maps import GarmentMaps
from uvcloth.methods.motion_guided.latent import Space
from uvcloth.methods.motion_guided.seeds import PosedSeeds, pose_seeds, seeds_on

from ..mirror import mirror_clips
from ..posed_batch import PosedMeshBatch

CLEARANCE = 0.002
"""Metres that the rest shape should keep off the body at rest (epsilon of L_SDF)."""

FRAMES_AT_ONCE = 16
"""Frames that are skinned, encoded or decoded at once: bounds the memory."""


@dataclass(frozen=True)
class GarmentFrames:
    """R frames of the garment, clip after clip, each led in by MEMORY frames of its warm-up.

    vertices: (R, N, 3) m, world; offsets: (R, P, 3) of their texels from the smooth LBS reference. pose: of
    the body.
    """

    rows: Rows
    vertices: Tensor
    offsets: Tensor
    pose: Pose


def load_frames(clips: list[SimulatedClip], garment: str, under: str, maps: GarmentMaps) -> GarmentFrames:
    """Join the clips on the device of the maps; under: the garment that the seeds lie on, if any."""
    device, seeds = maps.points.device, []
    for clip, first in led_in(clips, MEMORY):
        transforms = clip.transforms[first:].to(device)
        if under:
            vertices = clip.by_name[under].vertices[first:].to(device)
            seeds.append(seeds_on(maps.seeds, vertices, transforms))
        else:
            seeds.append(pose_seeds(maps.seeds, transforms))
    rows: Rows = to_device(joined_rows(clips, MEMORY), device)
    simulated = joined_vertices(clips, garment, MEMORY).to(device).float()
    return GarmentFrames(
        rows=rows,
        vertices=simulated,
        offsets=offsets_of(maps, simulated, rows.transforms),
        pose=Pose(rows.transforms, joined_seeds(seeds)),
    )


def joined_seeds(parts: list[PosedSeeds]) -> PosedSeeds:
    """The frames of several one after another."""
    return PosedSeeds(
        torch.cat([part.points for part in parts]),
        torch.cat([part.normals for part in parts]),
        torch.cat([part.rotations for part in parts]),
    )


def offsets_of(maps: GarmentMaps, vertices: Tensor, transforms: Tensor) -> Tensor:
    """Texels of garments (R, N, 3) as offsets from the smooth LBS reference (R, P, 3), some at a time."""
    parts = zip(vertices.split(FRAMES_AT_ONCE), transforms.split(FRAMES_AT_ONCE), strict=True)
    return torch.cat([local_offsets(maps, maps.positions(v), now) for v, now in parts])


def load_clips_of(rests: dict[str, Tensor], data: Sequence[Path]) -> list[SimulatedClip]:
    """The training clips with all of some garments. rests: by name, (N, 3) m, their vertices at rest.

    Raises InputError if there is none, or if one is of another garment or body.
    """
    by_body = read_clips(data, tuple(rests))
    dressed = [(body, [c for c in clips if rests.keys() <= c.by_name.keys()]) for body, clips in by_body]
    if not any(clips for _, clips in dressed):
        folders = " ".join(map(str, data))
        raise InputError(f"{folders}: no training clip was simulated with {' and '.join(rests)}")
    for body, clips in dressed:
        require_rests(rests, clips, body)
    return [clip for _, clips in dressed for clip in clips]


class GarmentDataset:
    """The training data of both stages: one garment on one body, training and validation clips."""

    def __init__(
        self,
        config: MotionGuidedConfig,
        holdout: Holdout,
        data: Sequence[Path],
        frames: int | None = None,
        device: torch.device = CPU,
        mirror: bool = False,
    ) -> None:
        """Read the data and put it on the device.

        data: folders of sequences, all on one body. frames: train on the first so many only, clip after clip,
        None for all. mirror: and on their mirror images.

        Raises InputError if it lacks the garment or what is worn under it, or is of another garment or body.
        """
        folders = " ".join(map(str, data))
        self.body = folder_body(data[0])
        self.garment = garment = load_garment_for_data(config.garment, self.body)
        under = load_garment_for_data(config.under, self.body) if config.under else None
        self.config = config = replace(
            config,
            garment=garment.name,
            under=under.name if under else "",
            vertices=len(garment.mesh.vertices),
        )
        rests = {g.name: g.mesh.vertices for g in (garment, under) if g}
        dealt = hold_out(load_clips_of(rests, data), holdout, folders)
        training, held = of_split(dealt, "train"), of_split(dealt, "validation")
        if not training or not held:
            raise InputError(f"{folders}: needs two clips of {garment.name} at least, one to validate with")
        if frames is not None and frames < 2:
            raise InputError(f"--frames {frames}: has to be 2 or more")
        self.data = training_data(dealt)
        self.device, self.clips = device, held
        maps = to_device(config.maps(garment, self.body, under), device)
        images = mirror_clips(training, self.body, [g for g in (garment, under) if g]) if mirror else []
        learned = load_frames([*training, *images], garment.name, config.under, maps)
        counted = learned.rows.samples.view(2 if images else 1, -1)[:, :frames]
        learned = replace(learned, rows=replace(learned.rows, samples=counted.flatten()))
        self.training, self.maps = learned, maps
        self.held = load_frames(held, garment.name, config.under, maps)
        edges = unique_edges(garment.mesh.faces)
        count = len(garment.mesh.vertices)
        self.edges: Operator = to_device(differences(edges, count), device)
        self.lengths = edge_lengths(garment.mesh.vertices, edges).to(device)
        smooth = laplacian(garment.mesh.faces, count)
        self.laplacian: Operator = to_device(
            Operator(smooth.to_sparse_csr(), smooth.t().to_sparse_csr()), device
        )
        self.sample: Operator = to_device(sampling(maps.pixels, maps.shares, 4 * config.size**2), device)
        self.frames = counted.shape[1]
        also = ", and their mirror images" if images else ""
        if mirror and not images:
            also = f"; {garment.name} is not symmetric, so mirror images are left out"
        Console().print(
            f"{self.frames} training frames of {len(training)} clips{also}; "
            f"{count_frames(held)} validation frames ({', '.join(clip.name for clip in held)})"
        )

    @cached_property
    def skin(self) -> PosedMeshBatch:
        """The body at rest. Its search is compiled for a GPU first, which takes a while."""
        mesh = self.body.mesh
        return PosedMeshBatch(mesh.vertices.to(self.device), mesh.faces, 1)

    def codes(self, space: Space, frames: GarmentFrames, rows: Tensor) -> Tensor:
        """Z* of simulated garments in chosen rows: (B, Z)."""
        texels = self.maps.positions(frames.vertices[rows])
        inputs = (texels, frames.offsets[rows], frames.pose.seeds.points[rows])
        return space.encode(shape_features(space, self.maps, *inputs))

    def depth(self, resting: Tensor) -> Tensor:
        """L_SDF: mean depth below CLEARANCE of rest shapes (B, N, 3), by the exact distance to the body."""
        points = resting.reshape(1, -1, 3)
        distance = self.skin.planes(points, CLEARANCE).distance(points)
        return (CLEARANCE - distance).clamp(min=0.0).mean()
