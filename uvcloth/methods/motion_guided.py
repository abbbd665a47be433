"""Motion-guided: a latent dynamic encoder with Gaussian-kernel skinning, fed its own predictions."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
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
from uvcloth.bodies.frames import BodyFrames
from uvcloth.checkpoint import Checkpoint, body_identity
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.mesh import Mesh, vertex_normals
from uvcloth.methods.correspondence import gather, rotate
from uvcloth.methods.descriptor import contact_forces
from uvcloth.methods.latent import Dynamics, ShapeSpace, uv_encoding
from uvcloth.methods.seeds import PosedSeeds, Seeds, kernel_skin, pose_seeds, sample_seeds
from uvcloth.skinning import skin

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
    latent: int = 64
    """Length of a latent code."""
    hidden: int = 64
    """Width of the perceptron that displaces vertices."""
    layers: int = 4
    """Its layers (paper: 6)."""
    norm: Literal["batch", "group", "instance"] = "group"
    """Normalization layers (paper: instance)."""
    upsample: Literal["transposed", "resize"] = "resize"
    """How the decoder enlarges (paper: transposed)."""
    seeds: int = 581
    """Seed points on the body."""
    near: int = 64
    """Of them, those nearest at rest that may move a vertex (paper: all)."""
    heading: bool = True
    """Maps hold vectors in axes that turn with the body's heading (paper: the world's)."""
    contact: bool = True
    """The next frame sees the garment after contact; else as it was predicted."""
    sigma: float = 0.04
    """Metres within which a seed's plane pushes the garment."""

    def __post_init__(self) -> None:
        """Raises InputError for maps that cannot be halved down to 2 x 2."""
        if self.size < 4 or self.size & (self.size - 1):
            raise InputError(f"--size {self.size}: has to be a power of two, 4 or more")

    @property
    def widths(self) -> tuple[int, ...]:
        """Channels of the encoders' levels, which halve the maps down to 2 x 2."""
        levels = int(math.log2(self.size)) - 1
        return tuple(self.width * min(2**level, 8) for level in range(levels))

    def shape_space(self) -> ShapeSpace:
        """The first stage, untrained."""
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
        )

    def dynamics(self) -> Dynamics:
        """The second stage, untrained."""
        return Dynamics(
            seeds=self.seeds,
            width=self.width,
            widths=self.widths,
            stem=self.motion_stem,
            latent=self.latent,
            norm=self.norm,
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
        upsample="transposed",
        near=581,
        heading=False,
    ),
    "tiny": MotionGuidedConfig(size=8, width=8, hidden=16, seeds=61, near=16),
}


@dataclass(frozen=True)
class GarmentMaps:
    """A garment at rest on a body, as the networks see it: fixed from frame to frame.

    sheet: its P texels. corners, shares: (P, 3) vertices around each. mask: (1, 1, H, W). points: (N, 3) m at
    rest; axes: (N, 3, 3) local frames there. pixels, samples: (N, K) of the decoded map, and their shares.
    places: (N, C) encoded texture coordinates. near: (N, K) seeds. seeds: on the body.
    """

    sheet: Texels
    corners: Tensor
    mask: Tensor
    points: Tensor
    axes: Tensor
    pixels: Tensor
    shares: Tensor
    places: Tensor
    near: Tensor
    seeds: Seeds

    def positions(self, vertices: Tensor) -> Tensor:
        """Values of garment vertices (B, N, 3) at the texels: (B, P, 3)."""
        return gather(vertices, self.corners, self.sheet.barycentrics)

    def sample(self, decoded: Tensor) -> Tensor:
        """Values of decoded maps (B, 4 H W, C) at the vertices: (B, N, C)."""
        return gather(decoded, self.pixels, self.shares)

    def map(self, values: Tensor) -> Tensor:
        """Texel values (B, P, C) as maps (B, C, H, W), zero off the charts."""
        return scatter_map(values, self.sheet)


def garment_maps(config: MotionGuidedConfig, garment: Garment, body: Body) -> GarmentMaps:
    """Lay a garment out on its maps; one without texture coordinates is unwrapped first."""
    mesh = garment.mesh
    uvs, face_uvs = (mesh.uvs, mesh.face_uvs) if len(mesh.uvs) else unwrap(mesh.vertices, mesh.faces)
    layout = whole_layout(uvs, face_uvs)
    sheet, fine = (rasterize_layout(layout, size) for size in (config.size, 2 * config.size))
    seeds = sample_seeds(body, config.seeds)
    face, corner = _a_corner_of_each(mesh)
    at_vertex = torch.nn.functional.one_hot(corner, 3).float()
    sampler = sample_points(layout, fine, mesh.faces, face, at_vertex)
    near = torch.cdist(mesh.vertices, seeds.points).topk(min(config.near, config.seeds), largest=False)
    return GarmentMaps(
        sheet=sheet,
        corners=mesh.faces[sheet.face],
        mask=valid_mask(sheet).float()[None, None],
        points=mesh.vertices,
        axes=local_axes(mesh),
        pixels=sampler.pixels,
        shares=sampler.weights,
        places=uv_encoding(uvs[face_uvs[face, corner]]),
        near=near.indices,
        seeds=seeds,
    )


def whole_layout(uvs: Tensor, face_uvs: Tensor) -> Layout:
    """A mesh's own texture coordinates as a layout of all of its faces."""
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


def headings(transforms: Tensor) -> Tensor:
    """Rotations about Z (B, 3, 3) that turn the rest pose as the root joint of (B, J, 3, 4) is turned."""
    forward = transforms[:, 0, :, 1]
    angle = torch.atan2(-forward[:, 0], forward[:, 1])
    cosine, sine, zero = angle.cos(), angle.sin(), 0.0 * angle
    one = zero + 1.0
    rows = [cosine, -sine, zero, sine, cosine, zero, zero, zero, one]
    return torch.stack(rows, dim=1).view(-1, 3, 3)


@dataclass(frozen=True)
class Situation:
    """What stage two sees of B frames, in the axes of `turn` and metres around `origin`.

    before: (B, MEMORY, N, 3) the garments before, newest first. seeds_before, seeds: the body then and now.
    turn: (B, 3, 3). origin: (B, 3). fps: frames per second.
    """

    before: Tensor
    seeds_before: PosedSeeds
    seeds: PosedSeeds
    turn: Tensor
    origin: Tensor
    fps: float

    def local(self, points: Tensor) -> Tensor:
        """World points (B, N, 3) as the maps hold them."""
        return (points - self.origin[:, None]) @ self.turn

    def local_vectors(self, vectors: Tensor) -> Tensor:
        """World vectors (B, N, 3) as the maps hold them."""
        return vectors @ self.turn


def shape_features(space: ShapeSpace, maps: GarmentMaps, vertices: Tensor, seeds: Tensor) -> Tensor:
    """S(M^P) of garments (B, N, 3) beside seeds (B, S, 3), both local: (B, width, H, W)."""
    return space.features(maps.map(maps.positions(vertices)), maps.mask, seeds)


def rest_shape(
    space: ShapeSpace, maps: GarmentMaps, codes: Tensor, sample: Callable[[Tensor], Tensor] | None = None
) -> Tensor:
    """Codes (B, Z) -> the garment in the rest space (B, N, 3), m.

    sample: what serves for `maps.sample` where its gradient is wanted fast.
    """
    displaced = space.decode(codes, sample or maps.sample, maps.places)
    return maps.points + rotate(maps.axes, displaced)


def posed_shape(space: ShapeSpace, maps: GarmentMaps, resting: Tensor, posed: PosedSeeds) -> Tensor:
    """Skin rest-space garments (B, N, 3) to the posed body: (B, N, 3), m, world."""
    return kernel_skin(resting, maps.near, space.radii, maps.seeds, posed)


def situation_features(
    space: ShapeSpace, dynamics: Dynamics, maps: GarmentMaps, seen: Situation, sigma: float
) -> tuple[Tensor, Tensor]:
    """S(M^P_{t-1}) and E_t."""
    last = seen.local(seen.before[:, 0])
    seeds_before = seen.local(seen.seeds_before.points)
    features = shape_features(space, maps, last, seeds_before)
    velocity = (seen.before[:, :-1] - seen.before[:, 1:]) * seen.fps
    acceleration = (velocity[:, 0] - velocity[:, 1]) * seen.fps
    motion = torch.cat([seen.local_vectors(velocity[:, 0]), seen.local_vectors(acceleration)], dim=2)
    normals = seen.local_vectors(seen.seeds.normals)
    forces = contact_forces(maps.positions(last), seeds_before, seen.local(seen.seeds.points), normals, sigma)
    change = dynamics.change(maps.map(maps.positions(motion)), forces, normals, maps.sheet.pixels)
    return features, change


@dataclass(frozen=True)
class Rolling:
    """A garment on its way. maps: as the networks see it. before: (1, MEMORY, N, 3) m, newest first."""

    maps: GarmentMaps
    before: Tensor


@dataclass(frozen=True)
class MotionGuided:
    """A Method with memory: each garment of an outfit is rolled out by itself."""

    config: MotionGuidedConfig
    space: ShapeSpace
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
        return tuple(self._hang(garment, outfit.body, frames) for garment in outfit.garments)

    def _hang(self, garment: Garment, body: Body, frames: BodyFrames) -> Rolling:
        still = skin(garment.mesh.vertices, garment.carrier_weights, frames.transforms[:1, 0])
        return Rolling(garment_maps(self.config, garment, body), still[:, None].repeat(1, MEMORY, 1, 1))

    @torch.no_grad()
    def step(self, state: tuple[Rolling, ...], frames: BodyFrames) -> tuple[Any, tuple[Tensor, ...]]:
        """The next garments (1, N, 3), m, from the last ones."""
        moved = tuple(self._next(worn, frames) for worn in state)
        following = tuple(
            replace(worn, before=torch.cat([vertices[:, None], worn.before[:, :-1]], dim=1))
            for worn, vertices in zip(state, moved, strict=True)
        )
        return following, moved

    def observe(self, state: tuple[Rolling, ...], garments: tuple[Tensor, ...]) -> tuple[Rolling, ...]:
        """Go on from the garments as they were after contact, unless the config says otherwise."""
        if not self.config.contact:
            return state
        return tuple(
            replace(worn, before=torch.cat([vertices[None, None], worn.before[:, 1:]], dim=1))
            for worn, vertices in zip(state, garments, strict=True)
        )

    def _next(self, worn: Rolling, frames: BodyFrames) -> Tensor:
        transforms = frames.transforms
        seeds = pose_seeds(worn.maps.seeds, transforms[0, -2:])
        seen = Situation(
            before=worn.before,
            seeds_before=seeds[:1],
            seeds=seeds[1:],
            turn=turns(self.config, transforms[:, -1]),
            origin=transforms[:, -2, 0, :, 3],
            fps=frames.fps,
        )
        features, change = situation_features(self.space, self.dynamics, worn.maps, seen, self.config.sigma)
        codes = self.dynamics(features, change)
        return posed_shape(self.space, worn.maps, rest_shape(self.space, worn.maps, codes), seen.seeds)


def turns(config: MotionGuidedConfig, transforms: Tensor) -> Tensor:
    """The axes (B, 3, 3) of the maps at joint transforms (B, J, 3, 4)."""
    if config.heading:
        return headings(transforms)
    return torch.eye(3, device=transforms.device).expand(len(transforms), 3, 3)


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
    try:
        missing = {f.name for f in fields(MotionGuidedConfig)} - checkpoint.config.keys()
        if missing:
            raise KeyError(*sorted(missing))
        method = MotionGuidedConfig(**checkpoint.config).create()
        Both(method).load_state_dict(checkpoint.tensors)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        first = str(error).splitlines()[0]
        raise InputError(
            f"{folder}: weights and config of the model do not fit each other ({first})"
        ) from error
    method.space.eval()
    method.dynamics.eval()
    return method


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
