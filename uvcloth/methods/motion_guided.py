"""Motion-guided: a latent dynamic encoder with Gaussian-kernel skinning, fed its own predictions."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor, nn

from rasterize.bake import scatter_map, valid_mask
from rasterize.charts import face_components
from rasterize.decode import sample_points
from rasterize.errors import InputError
from rasterize.layout import Layout, unwrap
from rasterize.texels import Texels, rasterize_layout
from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.bodies.frames import GRAVITY, BodyFrames
from uvcloth.checkpoint import Checkpoint, body_identity, restored
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.mesh import Mesh, laplacian, vertex_normals
from uvcloth.methods.correspondence import carry, gather, rotate, rotate_back, weighted_rows
from uvcloth.methods.descriptor import contact_forces
from uvcloth.methods.latent import Dynamics, LinearSpace, ShapeSpace, Space, uv_encoding
from uvcloth.methods.residual import Resolver
from uvcloth.methods.seeds import (
    Kernels,
    PosedSeeds,
    Seeds,
    kernel_skin,
    kernel_transforms,
    nearest_kernels,
    pose_seeds,
    sample_seeds,
)
from uvcloth.physics.contact import Obstacle
from uvcloth.skinning import apply_transforms, skin

MEMORY = 3
"""Garments that the state holds: the last one, and two more for its velocity and acceleration."""


@dataclass(frozen=True)
class MotionGuidedConfig:
    """What the networks see and are made of; `PRESETS["paper"]` is the method as published."""

    garment: str = "dress"
    """The template that the networks are for: they are garment-specific."""
    size: int = 32
    """Height and width of the maps that are encoded (paper: 128); the decoded ones have twice as much."""
    width: int = 32
    """Channels of maps at full size (paper: 128)."""
    stem: int = 2
    """Convolutions at full size before the encoders (paper: 4 on the garment)."""
    motion_stem: int = 2
    """Convolutions at full size on motion and contact (paper: 6)."""
    linear: bool = True
    """The space of shapes is linear, fitted in closed form; else a convolutional autoencoder (paper)."""
    latent: int = 64
    """Length of a latent code."""
    hidden: int = 64
    """Width of the perceptron that displaces vertices."""
    layers: int = 4
    """Its layers (paper: 6)."""
    norm: Literal["batch", "group", "instance"] = "instance"
    """Normalization layers."""
    dropout: float = 0.4
    """Share of what the dynamic encoder's last layer sees that training drops (paper: 0)."""
    upsample: Literal["transposed", "resize"] = "resize"
    """How the decoder enlarges (paper: transposed)."""
    seeds: int = 581
    """Seed points on the body."""
    near: int = 64
    """Of them, those nearest at rest that may move a vertex (paper: all)."""
    carried: bool = True
    """What is encoded: offsets from the smoothly skinned garment, in axes that it carries along, their change
    and the motion of that garment; else positions relative to every seed and the garment's own motion, along
    the world's axes (paper)."""
    contact: bool = True
    """The next frame sees the garment after contact; else as it was predicted."""
    residual: bool = False
    """Collisions are resolved by a residual displacement map first (paper, section 5.1)."""
    sigma: float = 0.04
    """Metres within which a seed's plane pushes the garment."""

    def __post_init__(self) -> None:
        """Raises InputError for maps that cannot be halved down to 2 x 2, or inputs that do not fit."""
        if self.linear and not self.carried:
            raise InputError("--no-carried: a linear space needs offsets from the carrier, add --no-linear")
        if self.size < 4 or self.size & (self.size - 1):
            raise InputError(f"--size {self.size}: has to be a power of two, 4 or more")

    @property
    def widths(self) -> tuple[int, ...]:
        """Channels of the encoders' levels, which halve the maps down to 2 x 2."""
        levels = int(math.log2(self.size)) - 1
        return tuple(self.width * min(2**level, 8) for level in range(levels))

    def shape_space(self) -> Space:
        """The first stage, untrained."""
        if self.linear:
            return LinearSpace(size=self.size, latent=self.latent)
        return ShapeSpace(
            seeds=self.seeds,
            width=self.width,
            widths=self.widths,
            stem=self.stem,
            latent=self.latent,
            hidden=self.hidden,
            layers=self.layers,
            norm=self.norm,
            upsample=self.upsample,
            carried=self.carried,
            size=self.size,
        )

    def dynamics(self) -> Dynamics:
        """The second stage, untrained."""
        return Dynamics(
            features=3 if self.linear else self.width,
            motion=12 if self.carried else 6,
            seeds=self.seeds,
            width=self.width,
            widths=self.widths,
            stem=self.motion_stem,
            latent=self.latent,
            norm=self.norm,
            dropout=self.dropout,
        )

    def create(self) -> "MotionGuided":
        """Build the method with untrained weights."""
        return MotionGuided(self, self.shape_space(), self.dynamics())


PRESETS: dict[str, MotionGuidedConfig] = {
    "fast": MotionGuidedConfig(),
    "paper": MotionGuidedConfig(
        size=128,
        width=128,
        stem=4,
        motion_stem=6,
        hidden=128,
        layers=6,
        norm="instance",
        dropout=0.0,
        upsample="transposed",
        near=581,
        linear=False,
        carried=False,
        residual=True,
    ),
    "tiny": MotionGuidedConfig(size=8, width=8, hidden=16, seeds=61, near=16),
}


@dataclass(frozen=True)
class GarmentMaps:
    """A garment at rest on a body, as the networks see it: fixed from frame to frame.

    sheet: its P texels; fine: those of the decoded map. corners: (P, 3) vertices around each. mask:
    (1, 1, H, W). points: (N, 3) m at rest; axes: (N, 3, 3) local frames there. pixels, shares: (N, K) samples
    of the decoded map. places: (N, C) encoded texture coordinates. kernels: of the seeds near each vertex.
    carrier_weights: (N, J).
    """

    sheet: Texels
    fine: Texels
    corners: Tensor
    mask: Tensor
    points: Tensor
    axes: Tensor
    pixels: Tensor
    shares: Tensor
    places: Tensor
    kernels: Kernels
    seeds: Seeds
    carrier_weights: Tensor

    def positions(self, vertices: Tensor) -> Tensor:
        """Values of garment vertices (B, N, 3) at the texels: (B, P, 3)."""
        return gather(vertices, self.corners, self.sheet.barycentrics)

    def sample(self, decoded: Tensor) -> Tensor:
        """Values of decoded maps (B, 4 H W, C) at the vertices: (B, N, C)."""
        return weighted_rows(decoded, self.pixels, self.shares)

    def map(self, values: Tensor) -> Tensor:
        """Texel values (B, P, C) as maps (B, C, H, W), zero off the charts."""
        return scatter_map(values, self.sheet)


def garment_maps(config: MotionGuidedConfig, garment: Garment, body: Body) -> GarmentMaps:
    """Lay a garment out on its maps; one without texture coordinates is unwrapped first."""
    mesh = garment.mesh
    layout = own_layout(mesh)
    sheet, fine = (rasterize_layout(layout, size) for size in (config.size, 2 * config.size))
    seeds = sample_seeds(body, config.seeds)
    face, corner = _a_corner_of_each(mesh)
    at_vertex = torch.nn.functional.one_hot(corner, 3).float()
    sampler = sample_points(layout, fine, mesh.faces, face, at_vertex)
    return GarmentMaps(
        sheet=sheet,
        fine=fine,
        corners=mesh.faces[sheet.face],
        mask=valid_mask(sheet).float()[None, None],
        points=mesh.vertices,
        axes=local_axes(mesh),
        pixels=sampler.pixels,
        shares=sampler.weights,
        places=uv_encoding(layout.uvs[layout.face_uvs[face, corner]]),
        kernels=nearest_kernels(mesh.vertices, seeds, config.near),
        seeds=seeds,
        carrier_weights=garment.carrier_weights,
    )


def own_layout(mesh: Mesh) -> Layout:
    """A mesh's own texture coordinates as a layout of all of its faces; unwrapped where it has none."""
    uvs, face_uvs = (mesh.uvs, mesh.face_uvs) if len(mesh.uvs) else unwrap(mesh.vertices, mesh.faces)
    islands = face_components(face_uvs.numpy(), np.zeros(0, dtype=np.int64))
    return Layout(torch.arange(len(face_uvs)), uvs, face_uvs, torch.from_numpy(islands).long())


def local_axes(mesh: Mesh) -> Tensor:
    """H_0: columns tangent, bitangent and normal at each vertex (N, 3, 3), the tangent level."""
    normals = vertex_normals(mesh.vertices, mesh.faces)
    level = torch.stack([-normals[:, 1], normals[:, 0], 0.0 * normals[:, 0]], dim=1)
    steep = level.norm(dim=1, keepdim=True) < 1e-3
    level = torch.where(steep, level.new_tensor([1.0, 0.0, 0.0]), level)
    tangent = torch.nn.functional.normalize(level - (level * normals).sum(1, keepdim=True) * normals, dim=1)
    return torch.stack([tangent, torch.linalg.cross(normals, tangent), normals], dim=2)


def _a_corner_of_each(mesh: Mesh) -> tuple[Tensor, Tensor]:
    """For every vertex a face (N,) that has it and which of its corners (N,) it is."""
    corner = torch.zeros(len(mesh.vertices), dtype=torch.int64)
    corner[mesh.faces.flatten()] = torch.arange(mesh.faces.numel())
    return corner // 3, corner % 3


@dataclass(frozen=True)
class Situation:
    """What comes before the next garment, of B frames.

    before: (B, MEMORY, N, 3) m, world, the garments before, newest first; offsets: the same, as offsets from
    their carriers. transforms: (B, MEMORY, J, 3, 4) of the body, now first. seeds_before, seeds: the body
    then and now. fps: frames per second.
    """

    before: Tensor
    offsets: Tensor
    transforms: Tensor
    seeds_before: PosedSeeds
    seeds: PosedSeeds
    fps: float


def carried_offsets(maps: GarmentMaps, vertices: Tensor, transforms: Tensor) -> Tensor:
    """Garments (B, N, 3) m as offsets from the smoothly skinned garment, in axes that it carries along."""
    origins, frames = carry(maps.points, maps.carrier_weights, transforms)
    return rotate_back(frames, vertices - origins)


def shape_features(
    space: Space, maps: GarmentMaps, vertices: Tensor, offsets: Tensor, seeds: Tensor
) -> Tensor:
    """S(M^P) of garments (B, N, 3) m, world, and as offsets, beside seeds (B, S, 3): (B, width, H, W)."""
    if space.carried:
        return space.features(maps.map(maps.positions(offsets)))
    middle = seeds.mean(1, keepdim=True)
    return space.features(maps.map(maps.positions(vertices - middle)), maps.mask, seeds - middle)


def motion_values(carried: bool, maps: GarmentMaps, seen: Situation) -> Tensor:
    """What moves, of every vertex (B, N, C), m/s and m/s2: C = 6 as published, the garment's own motion.

    Carried, C = 12: the changes of its offsets, and the carrier's velocity and specific force, in the axes
    that it carries along.
    """
    past = seen.offsets if carried else seen.before
    velocity = (past[:, :-1] - past[:, 1:]) * seen.fps
    own = [velocity[:, 0], (velocity[:, 0] - velocity[:, 1]) * seen.fps]
    if not carried:
        return torch.cat(own, dim=2)
    now, frames = carry(maps.points, maps.carrier_weights, seen.transforms[:, 0])
    before, earlier = (skin(maps.points, maps.carrier_weights, seen.transforms[:, k]) for k in (1, 2))
    velocity = (now - before) * seen.fps
    force = (velocity - (before - earlier) * seen.fps) * seen.fps - now.new_tensor(GRAVITY)
    return torch.cat([*own, rotate_back(frames, velocity), rotate_back(frames, force)], dim=2)


def situation_features(
    space: Space, dynamics: Dynamics, maps: GarmentMaps, seen: Situation, sigma: float
) -> tuple[Tensor, Tensor]:
    """S(M^P_{t-1}) and E_t."""
    last, before = seen.before[:, 0], seen.seeds_before.points
    features = shape_features(space, maps, last, seen.offsets[:, 0], before)
    motion = maps.map(maps.positions(motion_values(space.carried, maps, seen)))
    forces = contact_forces(maps.positions(last), before, seen.seeds.points, seen.seeds.normals, sigma)
    return features, dynamics.change(motion, forces, seen.seeds.normals, maps.sheet.pixels)


def rest_shape(
    space: Space, maps: GarmentMaps, codes: Tensor, sample: Callable[[Tensor], Tensor] | None = None
) -> Tensor:
    """Codes (B, Z) -> the garment in the rest space (B, N, 3), m.

    sample: what serves for `maps.sample` where its gradient is wanted fast.
    """
    displaced = space.decode(codes, sample or maps.sample, maps.places)
    return maps.points + rotate(maps.axes, displaced)


def next_shape(space: Space, dynamics: Dynamics, maps: GarmentMaps, seen: Situation, sigma: float) -> Tensor:
    """The next garment in the rest space (B, N, 3), m."""
    return rest_shape(space, maps, dynamics(*situation_features(space, dynamics, maps, seen, sigma)))


def posed_shape(space: Space, maps: GarmentMaps, resting: Tensor, posed: PosedSeeds) -> Tensor:
    """Skin rest-space garments (B, N, 3) to the posed body: (B, N, 3), m, world."""
    return kernel_skin(resting, maps.kernels, space.radii, maps.seeds, posed)


@dataclass(frozen=True)
class Rolling:
    """A garment on its way.

    maps: as the networks see it. before, offsets: (1, MEMORY, N, 3) m, as in Situation. transforms:
    (1, J, 3, 4) of the newest. resolver: where collisions are resolved by a map, and residual: that map,
    (1, 4 H W, 3) m.
    """

    maps: GarmentMaps
    before: Tensor
    offsets: Tensor
    transforms: Tensor
    residual: Tensor
    resolver: Resolver | None = None

    def moved(self, vertices: Tensor, transforms: Tensor, drop: int) -> "Rolling":
        """With a newest garment (1, N, 3) more, and one fewer at place `drop`."""
        kept = [place for place in range(MEMORY) if place != drop]
        offsets = carried_offsets(self.maps, vertices, transforms)
        return replace(
            self,
            before=torch.cat([vertices[:, None], self.before[:, kept]], dim=1),
            offsets=torch.cat([offsets[:, None], self.offsets[:, kept]], dim=1),
            transforms=transforms,
        )


@dataclass(frozen=True)
class MotionGuided:
    """A Method with memory: each garment of an outfit is rolled out by itself."""

    config: MotionGuidedConfig
    space: Space
    dynamics: Dynamics
    name: str = "motion_guided"
    remembers: bool = True

    def start(self, outfit: Outfit, frames: BodyFrames) -> tuple[Rolling, ...]:
        """Let every garment hang still, smoothly skinned, on the body of the first frame.

        Raises InputError for a garment of another template than the networks are for.
        """
        for garment in outfit.garments:
            if garment.template != self.config.garment:
                raise InputError(
                    f"garment {garment.name}: the model is for template {self.config.garment!r}, "
                    f"this is one of {garment.template!r}"
                )
        self.space.eval()
        self.dynamics.eval()
        transforms = frames.transforms[:1, 0]
        hanging = []
        for garment in outfit.garments:
            maps = garment_maps(self.config, garment, outfit.body)
            still = skin(maps.points, maps.carrier_weights, transforms)[:, None].repeat(1, MEMORY, 1, 1)
            residual = torch.zeros(1, 4 * self.config.size**2, 3)
            resolver = self._resolver(garment, outfit.body) if self.config.residual else None
            hanging.append(Rolling(maps, still, torch.zeros_like(still), transforms, residual, resolver))
        return tuple(hanging)

    def _resolver(self, garment: Garment, body: Body) -> Resolver:
        obstacle = Obstacle(make_collider(body), body.mesh.vertices)
        mesh = garment.mesh
        worn = obstacle.dress(mesh.vertices, mesh.faces)
        return Resolver(obstacle, worn, laplacian(mesh.faces, len(mesh.vertices)))

    @torch.no_grad()
    def step(
        self, state: tuple[Rolling, ...], frames: BodyFrames
    ) -> tuple[tuple[Rolling, ...], tuple[Tensor, ...]]:
        """The next garments (1, N, 3), m, from the last ones."""
        following = tuple(self._next(worn, frames) for worn in state)
        return following, tuple(worn.before[:, 0] for worn in following)

    def observe(self, state: tuple[Rolling, ...], garments: tuple[Tensor, ...]) -> tuple[Rolling, ...]:
        """Go on from the garments as they were after contact, unless the config says otherwise."""
        if not self.config.contact:
            return state
        return tuple(
            worn.moved(vertices[None], worn.transforms, drop=0)
            for worn, vertices in zip(state, garments, strict=True)
        )

    def _next(self, worn: Rolling, frames: BodyFrames) -> Rolling:
        seeds = pose_seeds(worn.maps.seeds, frames.transforms[0, -2:])
        seen = Situation(
            before=worn.before,
            offsets=worn.offsets,
            transforms=frames.transforms.flip(1),
            seeds_before=seeds[:1],
            seeds=seeds[1:],
            fps=frames.fps,
        )
        maps = worn.maps
        resting = next_shape(self.space, self.dynamics, maps, seen, self.config.sigma)
        blended = kernel_transforms(resting, maps.kernels, self.space.radii, maps.seeds, seen.seeds)
        vertices = apply_transforms(blended, resting)
        if worn.resolver:
            worn.resolver.obstacle.update(frames.vertices[0, -1])
            turns = blended[0, :, :, :3] @ maps.axes
            resolved, residual = worn.resolver.resolve(vertices[0], turns, maps.sample, worn.residual)
            vertices, worn = resolved[None], replace(worn, residual=residual)
        return worn.moved(vertices, frames.transforms[:, -1], drop=MEMORY - 1)


class Both(nn.Module):
    """The networks of both stages, as a checkpoint holds them."""

    def __init__(self, method: MotionGuided) -> None:
        super().__init__()
        self.space, self.dynamics = method.space, method.dynamics


def load_motion_guided(checkpoint: Checkpoint, folder: Path) -> MotionGuided:
    """The trained method of a checkpoint.

    Raises InputError if weights and config do not fit each other, or if only the first stage was trained.
    """
    if not any(name.startswith("dynamics.") for name in checkpoint.tensors):
        raise InputError(
            f"{folder}: holds the first stage alone, the shape space; "
            "train on with `python -m train motion_guided --resume`"
        )
    return restored(checkpoint, folder, MotionGuidedConfig, Both)


def motion_guided_checkpoint(
    config: MotionGuidedConfig,
    tensors: dict[str, Tensor],
    body: Body,
    data: dict[str, str],
    notes: dict[str, Any],
) -> Checkpoint:
    """What training saves; data: training file -> content hash."""
    return Checkpoint(
        method="motion_guided",
        config=asdict(config),
        tensors=tensors,
        body=body_identity(body),
        templates=(config.garment,),
        data=data,
        notes=notes,
    )
