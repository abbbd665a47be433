"""The input of the dynamic encoder of Motion-guided, and the next garment that follows from it."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.geometry.rotations import rotate, rotate_back
from uvcloth.geometry.skinning import apply_transforms, blend_transforms, seen_from_root, skin, skin_frames
from uvcloth.geometry.units import FREE_FALL
from uvcloth.methods.motion_guided.descriptor import contact_forces
from uvcloth.methods.motion_guided.garment_maps import GarmentMaps
from uvcloth.methods.motion_guided.latent import Dynamics, Space
from uvcloth.methods.motion_guided.seeds import PosedSeeds, kernel_transforms

MEMORY = 3
"""Garments in a history: the last one, and two more for its velocity and acceleration."""


@dataclass(frozen=True)
class Pose:
    """The body of B frames: joint transforms (B, J, 3, 4), and the seeds that move with them."""

    transforms: Tensor
    seeds: PosedSeeds

    def __getitem__(self, rows: Tensor | slice) -> "Pose":
        """Some of the frames."""
        return Pose(self.transforms[rows], self.seeds[rows])


@dataclass(frozen=True)
class GarmentHistory:
    """The last MEMORY garments of B rollouts, newest first.

    texels: (B, MEMORY, P, 3) m, world. offsets: the same, from the smooth LBS reference, see `local_offsets`.
    """

    texels: Tensor
    offsets: Tensor

    def followed_by(self, maps: GarmentMaps, vertices: Tensor, transforms: Tensor) -> "GarmentHistory":
        """The history with new garments (B, N, 3) m first, on the body at transforms (B, J, 3, 4)."""
        return self._with(maps, vertices, transforms, slice(0, MEMORY - 1))

    def corrected(self, maps: GarmentMaps, vertices: Tensor, transforms: Tensor) -> "GarmentHistory":
        """The history with other garments (B, N, 3) m in place of the newest."""
        return self._with(maps, vertices, transforms, slice(1, MEMORY))

    def _with(self, maps: GarmentMaps, vertices: Tensor, transforms: Tensor, kept: slice) -> "GarmentHistory":
        """The history with new garments (B, N, 3) m first and those kept after them."""
        texels = maps.positions(vertices)
        offsets = local_offsets(maps, texels, transforms)
        return GarmentHistory(
            torch.cat([texels[:, None], self.texels[:, kept]], dim=1),
            torch.cat([offsets[:, None], self.offsets[:, kept]], dim=1),
        )


@dataclass(frozen=True)
class DynamicsInput:
    """The garments, poses and seeds that the next garment of B frames follows from.

    past: the garments before. transforms: (B, MEMORY, J, 3, 4) of the body, now first. seeds_before, seeds:
    the body then and now. fps: (B,) frames per second.
    """

    past: GarmentHistory
    transforms: Tensor
    seeds_before: PosedSeeds
    seeds: PosedSeeds
    fps: Tensor

    @property
    def pose(self) -> Pose:
        """The body now."""
        return Pose(self.transforms[:, 0], self.seeds)


def local_offsets(maps: GarmentMaps, texels: Tensor, transforms: Tensor) -> Tensor:
    """Texels (B, P, 3) m as offsets from the smoothly skinned garment, in axes that turn with it."""
    origins, frames = skin_frames(maps.texel_points, maps.texel_weights, transforms)
    return rotate_back(frames, texels - origins)


def shape_features(space: Space, maps: GarmentMaps, texels: Tensor, offsets: Tensor, seeds: Tensor) -> Tensor:
    """S(M^P) of texels (B, P, 3) m, world, and as offsets, beside seeds (B, S, 3): (B, width, H, W)."""
    if space.local_offsets:
        return space.features(maps.map(offsets))
    middle = seeds.mean(1, keepdim=True)
    return space.features(maps.map(texels - middle), maps.mask, seeds - middle)


def motion_of(local_offsets: bool, maps: GarmentMaps, inputs: DynamicsInput) -> Tensor:
    """Velocities and accelerations of every texel (B, P, C), m/s and m/s2.

    C = 6 as published, the garment's own motion. With local offsets, C = 12: the changes of its offsets, and
    the reference's velocity and specific force, in the axes that turn with it.
    """
    past = inputs.past.offsets if local_offsets else inputs.past.texels
    fps = inputs.fps[:, None, None]
    velocity = (past[:, 0] - past[:, 1]) * fps
    garment_motion = [velocity, (velocity - (past[:, 1] - past[:, 2]) * fps) * fps]
    if not local_offsets:
        return torch.cat(garment_motion, dim=2)
    now, frames = skin_frames(maps.texel_points, maps.texel_weights, inputs.transforms[:, 0])
    before, earlier = (skin(maps.texel_points, maps.texel_weights, inputs.transforms[:, k]) for k in (1, 2))
    velocity = (now - before) * fps
    force = (velocity - (before - earlier) * fps) * fps - now.new_tensor(FREE_FALL)
    return torch.cat([*garment_motion, rotate_back(frames, velocity), rotate_back(frames, force)], dim=2)


def state_features(
    space: Space, maps: GarmentMaps, texels: Tensor, offsets: Tensor, seeds: Tensor, transforms: Tensor
) -> Tensor:
    """S(M^P) of a garment, as `shape_features` takes it, and the pose of the body (B, J, 3, 4).

    With local offsets, the pose is the displacement, m, of the smooth LBS reference from its rest position,
    in the axes of the root joint; the published method has no pose here.
    """
    features = shape_features(space, maps, texels, offsets, seeds)
    if not space.local_offsets:
        return features
    reference = skin(maps.texel_points, maps.texel_weights, transforms)
    pose = seen_from_root(reference, transforms) - maps.texel_points
    return torch.cat([features, maps.map(pose)], dim=1)


def dynamics_features(
    space: Space, dynamics: Dynamics, maps: GarmentMaps, inputs: DynamicsInput, sigma: float
) -> tuple[Tensor, Tensor]:
    """S(M^P_{t-1}) and E_t; the pose of frame t belongs to the former, since it is not a change."""
    last, before = inputs.past.texels[:, 0], inputs.seeds_before.points
    features = state_features(space, maps, last, inputs.past.offsets[:, 0], before, inputs.transforms[:, 0])
    motion = motion_of(space.local_offsets, maps, inputs)
    forces = contact_forces(last, before, inputs.seeds.points, inputs.seeds.normals, sigma)
    return features, dynamics.change(maps.map(motion), forces, inputs.seeds.normals, maps.sheet.pixels)


def rest_shape(
    space: Space, maps: GarmentMaps, codes: Tensor, sample: Callable[[Tensor], Tensor] | None = None
) -> Tensor:
    """Codes (B, Z) -> the garment in the rest space (B, N, 3), m.

    sample: a function that replaces `maps.sample`, with a faster gradient.
    """
    displaced = space.decode(codes, sample or maps.sample, maps.places)
    return maps.points + rotate(maps.axes, displaced)


def next_shape(
    space: Space, dynamics: Dynamics, maps: GarmentMaps, inputs: DynamicsInput, sigma: float
) -> Tensor:
    """The next garment in the rest space (B, N, 3), m."""
    features, change = dynamics_features(space, dynamics, maps, inputs, sigma)
    return rest_shape(space, maps, dynamics(features, change))


def pose_transforms(space: Space, maps: GarmentMaps, resting: Tensor, pose: Pose) -> Tensor:
    """Transforms that pose each vertex of rest-space garments (B, N, 3): (B, N, 3, 4)."""
    if maps.skinning == "smooth_lbs":
        return blend_transforms(maps.smooth_weights, pose.transforms)
    where = resting if maps.skinning == "kernels" else maps.points.expand_as(resting)
    return kernel_transforms(where, maps.kernels, space.radii, maps.seeds, pose.seeds)


def posed_shape(space: Space, maps: GarmentMaps, resting: Tensor, pose: Pose) -> Tensor:
    """Skin rest-space garments (B, N, 3) to the posed body: (B, N, 3), m, world."""
    return apply_transforms(pose_transforms(space, maps, resting, pose), resting)
