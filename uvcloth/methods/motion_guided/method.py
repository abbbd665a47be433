"""Motion-guided: a latent dynamic encoder with Gaussian-kernel skinning, fed its own predictions."""

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor, nn

from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.bodies.frames import BodyFrames
from uvcloth.checkpoint import Checkpoint, TrainingData, body_identity, restored
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.mesh import laplacian
from uvcloth.geometry.skinning import apply_transforms, skin
from uvcloth.methods.motion_guided.dynamics_input import (
    MEMORY,
    DynamicsInput,
    local_offsets,
    next_shape,
    pose_transforms,
    rest_shape,
    shape_features,
)
from uvcloth.methods.motion_guided.garment_maps import GarmentMaps, Skinning, garment_maps
from uvcloth.methods.motion_guided.latent import Dynamics, LinearSpace, ShapeSpace, Space
from uvcloth.methods.motion_guided.residual import Resolver
from uvcloth.methods.motion_guided.seeds import PosedSeeds, pose_seeds, sample_seeds, seeds_on
from uvcloth.physics.contact import Obstacle


@dataclass(frozen=True)
class MotionGuidedConfig:
    """What the networks see and are made of; `PRESETS["paper"]` is the method as published."""

    garment: str = "dress"
    """The garment that the networks are for, a template or a mesh file: they are garment-specific."""
    under: str = ""
    """The garment worn beneath it, likewise, whose surface stands for the body's (section 6.5)."""
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
    vertices: int = 3600
    """Of the garment, to which a linear space decodes; training counts them."""
    latent: int = 64
    """Length of a latent code."""
    hidden: int = 64
    """Width of the perceptron that displaces vertices."""
    layers: int = 4
    """Its layers (paper: 6)."""
    norm: Literal["batch", "group", "instance", "none"] = "none"
    """Normalization layers (paper: instance, which hide how large a motion is)."""
    dropout: float = 0.2
    """Share of what the dynamic encoder's last layer sees that training drops (paper: 0)."""
    upsample: Literal["transposed", "resize"] = "resize"
    """How the decoder enlarges (paper: transposed)."""
    seeds: int = 581
    """Seed points on the body."""
    near: int = 64
    """Of them, those nearest at rest that may move a vertex by their kernels (paper: all)."""
    skinning: Skinning = "smooth_lbs"
    """What poses a shape: the smooth blend weights (smooth_lbs); or Gaussian kernels around the seeds,
    weighed at rest (fixed) or where a vertex is displaced to (kernels, paper)."""
    local_offsets: bool = True
    """What is encoded: offsets from the smooth LBS reference, in axes that turn with it, their
    change, and pose and motion of that garment; else positions relative to every seed and the garment's own
    motion, along the world's axes (paper)."""
    contact: bool = True
    """The next frame sees the garment after contact; else as it was predicted."""
    residual: bool = False
    """Collisions are resolved by a residual displacement map first (paper, section 5.1)."""
    sigma: float = 0.04
    """Metres within which a seed's plane pushes the garment."""

    def __post_init__(self) -> None:
        """Raises InputError for maps that cannot be halved down to 2 x 2, or inputs that do not fit."""
        if self.linear and not self.local_offsets:
            raise InputError("--no-local-offsets: a linear space needs these, add --no-linear")
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
            return LinearSpace(size=self.size, latent=self.latent, vertices=self.vertices)
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
            local_offsets=self.local_offsets,
            size=self.size,
        )

    def dynamics(self) -> Dynamics:
        """The second stage, untrained."""
        return Dynamics(
            features=(3 if self.linear else self.width) + (3 if self.local_offsets else 0),
            motion=12 if self.local_offsets else 6,
            seeds=self.seeds,
            width=self.width,
            widths=self.widths,
            stem=self.motion_stem,
            latent=self.latent,
            norm=self.norm,
            dropout=self.dropout,
        )

    def maps(self, garment: Garment, body: Body, under: Garment | None = None) -> GarmentMaps:
        """A garment on a body, or over what is worn under it, as the networks see it."""
        seeds = sample_seeds(body, self.seeds, under)
        return garment_maps(garment, seeds, self.size, self.near, self.skinning)

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
        skinning="kernels",
        linear=False,
        local_offsets=False,
        residual=True,
    ),
    "tiny": MotionGuidedConfig(size=8, width=8, hidden=16, seeds=61, near=16),
}


@dataclass(frozen=True)
class MotionGuidedState:
    """A garment on its way.

    maps: as the networks see it. vertices: (1, N, 3) m, the newest. before, offsets: (1, MEMORY, P, 3) m, as
    in DynamicsInput. transforms, seeds: (1, J, 3, 4) and posed, of the newest. resolver: where collisions are
    resolved by a map, and residual: that map, (1, 4 H W, 3) m.
    """

    maps: GarmentMaps
    vertices: Tensor
    before: Tensor
    offsets: Tensor
    transforms: Tensor
    seeds: PosedSeeds
    residual: Tensor
    resolver: Resolver | None = None

    def moved(self, vertices: Tensor, transforms: Tensor, drop: int) -> "MotionGuidedState":
        """With a newest garment (1, N, 3) more, and one fewer at place `drop`."""
        kept = [place for place in range(MEMORY) if place != drop]
        texels = self.maps.positions(vertices)
        offsets = local_offsets(self.maps, texels, transforms)
        return replace(
            self,
            vertices=vertices,
            before=torch.cat([texels[:, None], self.before[:, kept]], dim=1),
            offsets=torch.cat([offsets[:, None], self.offsets[:, kept]], dim=1),
            transforms=transforms,
        )


@dataclass(frozen=True)
class MotionGuided:
    """A Method with memory: each garment of an outfit is rolled out by itself.

    topology: of the garment's faces that the networks are for, where they were trained.
    """

    config: MotionGuidedConfig
    space: Space
    dynamics: Dynamics
    name: str = "motion_guided"
    topology: str = ""
    autoregressive: bool = True
    quasi_static: bool = False

    def unsupported_reason(self, outfit: Outfit) -> str:
        """It dresses one garment, over what it was trained over."""
        config, under = self.config, outfit.under
        for garment in outfit.garments:
            who = f"garment {garment.name}: model {self.name}"
            if garment.name != config.garment:
                return f"{who} is for the garment {config.garment}"
            if self.topology and faces_hash(garment) != self.topology:
                return f"{who} is for another mesh of that name"
            if config.under and (under is None or under.name != config.under):
                beneath = under.name if under else "nothing"
                return f"{who} is for it over {config.under}, here it is over {beneath}"
        return ""

    def start(self, outfit: Outfit, frames: BodyFrames) -> tuple[MotionGuidedState, ...]:
        """Let every garment hang still, smoothly skinned, on the body of the first frame.

        Raises InputError for another garment than the networks are for, or over another.
        """
        if unsupported_reason := self.unsupported_reason(outfit):
            raise InputError(unsupported_reason)
        self.space.eval()
        self.dynamics.eval()
        return tuple(self._hanging(garment, outfit, frames.transforms[:1, 0]) for garment in outfit.garments)

    def _hanging(self, garment: Garment, outfit: Outfit, transforms: Tensor) -> MotionGuidedState:
        under = outfit.under if self.config.under else None
        maps = self.config.maps(garment, outfit.body, under)
        still = skin(maps.points, maps.smooth_weights, transforms)
        before = maps.positions(still)[:, None].repeat(1, MEMORY, 1, 1)
        seeds = pose_seeds(maps.seeds, transforms)
        residual = torch.zeros(1, 4 * self.config.size**2, 3)
        resolver = self._resolver(garment, outfit.body) if self.config.residual else None
        offsets = torch.zeros_like(before)
        return MotionGuidedState(maps, still, before, offsets, transforms, seeds, residual, resolver)

    @torch.no_grad()
    def encode(self, garment: Garment, body: Body, vertices: Tensor, transforms: Tensor) -> Tensor:
        """Garments (B, N, 3) m, world, on a body moved by transforms (B, J, 3, 4) -> codes (B, latent)."""
        self.space.eval()
        maps = self.config.maps(garment, body)
        texels = maps.positions(vertices)
        seeds = pose_seeds(maps.seeds, transforms).points
        offsets = local_offsets(maps, texels, transforms)
        return self.space.encode(shape_features(self.space, maps, texels, offsets, seeds))

    @torch.no_grad()
    def decode(self, garment: Garment, body: Body, codes: Tensor) -> Tensor:
        """Codes (B, latent), those of training about standard normal -> the garment at rest (B, N, 3), m."""
        self.space.eval()
        return rest_shape(self.space, self.config.maps(garment, body), codes)

    def _resolver(self, garment: Garment, body: Body) -> Resolver:
        obstacle = Obstacle(make_collider(body), body.mesh.vertices)
        mesh = garment.mesh
        worn = obstacle.dress(mesh.vertices, mesh.faces)
        return Resolver(obstacle, worn, laplacian(mesh.faces, len(mesh.vertices)))

    @torch.no_grad()
    def step(
        self, state: tuple[MotionGuidedState, ...], frames: BodyFrames
    ) -> tuple[tuple[MotionGuidedState, ...], tuple[Tensor, ...]]:
        """The next garments (1, N, 3), m, from the last ones."""
        following = tuple(self._next(worn, frames) for worn in state)
        return following, tuple(worn.vertices for worn in following)

    def observe(
        self, state: tuple[MotionGuidedState, ...], garments: tuple[Tensor, ...]
    ) -> tuple[MotionGuidedState, ...]:
        """Go on from the garments as they were after contact, unless the config says otherwise."""
        if not self.config.contact:
            return state
        return tuple(
            worn.moved(vertices[None], worn.transforms, drop=0)
            for worn, vertices in zip(state, garments, strict=True)
        )

    def _next(self, worn: MotionGuidedState, frames: BodyFrames) -> MotionGuidedState:
        now = frames.transforms[:, -1]
        if self.config.under:
            assert frames.under is not None, "the garment beneath is stepped first"
            seeds = seeds_on(worn.maps.seeds, frames.under, now)
        else:
            seeds = pose_seeds(worn.maps.seeds, now)
        seen = DynamicsInput(
            before=worn.before,
            offsets=worn.offsets,
            transforms=frames.transforms.flip(1),
            seeds_before=worn.seeds,
            seeds=seeds,
            fps=frames.fps,
        )
        maps = worn.maps
        resting = next_shape(self.space, self.dynamics, maps, seen, self.config.sigma)
        blended = pose_transforms(self.space, maps, resting, seen.pose)
        vertices = apply_transforms(blended, resting)
        if worn.resolver:
            worn.resolver.obstacle.update(frames.vertices[0, -1])
            turns = blended[0, :, :, :3] @ maps.axes
            resolved, residual = worn.resolver.resolve(vertices[0], turns, maps.sample, worn.residual)
            vertices, worn = resolved[None], replace(worn, residual=residual)
        return replace(worn, seeds=seeds).moved(vertices, now, drop=MEMORY - 1)


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
    method: MotionGuided = restored(checkpoint, folder, MotionGuidedConfig, Both)
    return replace(method, topology=str(checkpoint.notes.get("garment_topology", "")))


def faces_hash(garment: Garment) -> str:
    """What tells garments of one name apart: their faces, those of the texture coordinates included."""
    return fingerprint(garment.mesh.faces, garment.mesh.face_uvs)


def motion_guided_checkpoint(
    config: MotionGuidedConfig,
    tensors: dict[str, Tensor],
    body: Body,
    data: TrainingData,
    notes: dict[str, Any],
) -> Checkpoint:
    """What training saves, in half precision."""
    return Checkpoint(
        method="motion_guided",
        config=asdict(config),
        tensors={name: tensor.half() for name, tensor in tensors.items()},
        body=body_identity(body),
        templates=(config.garment,),
        data=data,
        notes=notes,
    )
