"""Motion-guided: a latent dynamic encoder with Gaussian-kernel skinning, fed its own predictions."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.bodies.frames import BodyFrames
from uvcloth.checkpoint import Checkpoint, TrainingData, body_record, restored
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.mesh import laplacian
from uvcloth.geometry.records import to_device
from uvcloth.geometry.skinning import apply_transforms, skin
from uvcloth.methods.capabilities import Feedback, Representation
from uvcloth.methods.method import Method, MethodEntry, Traits, for_inference, require_supported
from uvcloth.methods.motion_guided.config import PRESETS, MotionGuidedConfig
from uvcloth.methods.motion_guided.dynamics_input import (
    MEMORY,
    DynamicsInput,
    GarmentHistory,
    Pose,
    local_offsets,
    next_shape,
    pose_transforms,
    posed_shape,
    rest_shape,
    shape_features,
)
from uvcloth.methods.motion_guided.garment_maps import GarmentMaps
from uvcloth.methods.motion_guided.latent import Dynamics, Space
from uvcloth.methods.motion_guided.residual import Resolver
from uvcloth.methods.motion_guided.seeds import PosedSeeds, pose_seeds, seeds_on
from uvcloth.physics.obstacle import Obstacle


@dataclass(frozen=True)
class MotionGuidedPrepared:
    """The networks, the maps of every garment, and the resolver of collisions if the config asks for one."""

    space: Space
    dynamics: Dynamics
    maps: tuple[GarmentMaps, ...]
    resolvers: tuple[Resolver, ...]


@dataclass(frozen=True)
class MotionGuidedState:
    """One garment of B rollouts.

    past: its last frames. transforms: (B, J, 3, 4) and seeds: of the body in the newest. residual: (B, 4 H W,
    3) m, the displacement map that resolved the last collisions.
    """

    past: GarmentHistory
    transforms: Tensor
    seeds: PosedSeeds
    residual: Tensor

    def displaced(self, shift: Tensor) -> "MotionGuidedState":
        """The state displaced by (B, 3) m."""
        return replace(
            self,
            past=replace(self.past, texels=self.past.texels + shift[:, None, None]),
            transforms=torch.cat(
                [self.transforms[..., :3], (self.transforms[..., 3] + shift[:, None])[..., None]], dim=-1
            ),
            seeds=replace(self.seeds, points=self.seeds.points + shift[:, None]),
        )


@dataclass(frozen=True)
class MotionGuided(Method, Feedback, Representation):
    """Each garment of an outfit is rolled out by itself.

    topology: hash of the garment's faces, for trained networks, see `faces_hash`.
    """

    config: MotionGuidedConfig
    space: Space
    dynamics: Dynamics
    name: str = "motion_guided"
    topology: str = ""
    traits = Traits(autoregressive=True)

    @classmethod
    def untrained(cls, config: MotionGuidedConfig) -> "MotionGuided":
        """The method with untrained weights."""
        return cls(config, config.shape_space(), config.dynamics())

    def unsupported_reason(self, outfit: Outfit) -> str:
        """Reason why it cannot dress an outfit: it is for one garment, over the inner garment of its
        training."""
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

    def prepare(self, outfit: Outfit, device: torch.device) -> MotionGuidedPrepared:
        """Lay every garment out on its maps.

        Raises InputError for another garment than the networks are for, or over another.
        """
        require_supported(self, outfit)
        config = self.config
        under = outfit.under if config.under else None
        maps = tuple(config.maps(garment, outfit.body, under) for garment in outfit.garments)
        return MotionGuidedPrepared(
            for_inference(self.space, device),
            for_inference(self.dynamics, device),
            to_device(maps, device),
            tuple(_resolver(g, outfit.body, device) for g in outfit.garments) if config.residual else (),
        )

    @torch.no_grad()
    def init(self, prepared: MotionGuidedPrepared, frames: BodyFrames) -> tuple[MotionGuidedState, ...]:
        """Let every garment rest, smoothly skinned, on the body before the first frames."""
        transforms = frames.transforms[:, 0]
        return tuple(self._still(maps, transforms) for maps in prepared.maps)

    def _still(self, maps: GarmentMaps, transforms: Tensor) -> MotionGuidedState:
        """The state of a garment that was smoothly skinned to the body at (B, J, 3, 4) until now."""
        still = skin(maps.points, maps.smooth_weights, transforms)
        texels = maps.positions(still)[:, None].repeat(1, MEMORY, 1, 1)
        return MotionGuidedState(
            past=GarmentHistory(texels, torch.zeros_like(texels)),
            transforms=transforms,
            seeds=pose_seeds(maps.seeds, transforms),
            residual=texels.new_zeros(len(transforms), 4 * self.config.size**2, 3),
        )

    @torch.no_grad()
    def step(
        self, prepared: MotionGuidedPrepared, state: tuple[MotionGuidedState, ...], frames: BodyFrames
    ) -> tuple[tuple[MotionGuidedState, ...], tuple[Tensor, ...]]:
        """The next garments (B, N, 3), m, from the last ones."""
        pairs = [self._next(prepared, index, before, frames) for index, before in enumerate(state)]
        return tuple(following for following, _ in pairs), tuple(vertices for _, vertices in pairs)

    @torch.no_grad()
    def feed_back(
        self,
        prepared: MotionGuidedPrepared,
        state: tuple[MotionGuidedState, ...],
        garments: tuple[Tensor, ...],
    ) -> tuple[MotionGuidedState, ...]:
        """Continue from the garments after contact, unless the config says otherwise."""
        if not self.config.contact:
            return state
        return tuple(
            replace(before, past=before.past.corrected(maps, vertices, before.transforms))
            for maps, before, vertices in zip(prepared.maps, state, garments, strict=True)
        )

    def displaced(
        self, prepared: MotionGuidedPrepared, state: tuple[MotionGuidedState, ...], shift: Tensor
    ) -> tuple[MotionGuidedState, ...]:
        """Displace the last garments, and body and seeds beneath them, by (B, 3) m."""
        return tuple(before.displaced(shift) for before in state)

    def garment_space(self, garment: Garment, body: Body) -> "DecodedSpace | None":
        """The space of shapes of the first stage."""
        if self.unsupported_reason(Outfit(body, (garment,))):
            return None
        space = for_inference(self.space, body.mesh.vertices.device)
        return DecodedSpace(space, self.config.maps(garment, body), self.config.latent)

    @torch.no_grad()
    def round_trip(
        self, prepared: MotionGuidedPrepared, frames: BodyFrames, garments: tuple[Tensor, ...]
    ) -> tuple[Tensor, ...]:
        """Garments (B, N, 3) encoded and decoded by the first stage."""
        transforms, read = frames.transforms[:, -1], []
        for maps, vertices in zip(prepared.maps, garments, strict=True):
            pose = Pose(transforms, self._seeds(maps, frames))
            texels = maps.positions(vertices)
            offsets = local_offsets(maps, texels, transforms)
            features = shape_features(prepared.space, maps, texels, offsets, pose.seeds.points)
            resting = rest_shape(prepared.space, maps, prepared.space.encode(features))
            read.append(posed_shape(prepared.space, maps, resting, pose))
        return tuple(read)

    def _seeds(self, maps: GarmentMaps, frames: BodyFrames) -> PosedSeeds:
        """The seeds in B frames, on the body or on the inner garment."""
        transforms = frames.transforms[:, -1]
        if not self.config.under:
            return pose_seeds(maps.seeds, transforms)
        assert frames.under is not None, "the garment beneath is stepped first"
        return seeds_on(maps.seeds, frames.under, transforms)

    def _next(
        self, prepared: MotionGuidedPrepared, index: int, state: MotionGuidedState, frames: BodyFrames
    ) -> tuple[MotionGuidedState, Tensor]:
        """The state after the frame and the garment (B, N, 3) in it."""
        maps, now = prepared.maps[index], frames.transforms[:, -1]
        seeds = self._seeds(maps, frames)
        inputs = DynamicsInput(
            past=state.past,
            transforms=frames.transforms.flip(1),
            seeds_before=state.seeds,
            seeds=seeds,
            fps=now.new_full((len(now),), frames.fps),
        )
        resting = next_shape(prepared.space, prepared.dynamics, maps, inputs, self.config.sigma)
        blended = pose_transforms(prepared.space, maps, resting, inputs.pose)
        vertices, residual = apply_transforms(blended, resting), state.residual
        if prepared.resolvers:
            turns = blended[..., :3] @ maps.axes
            resolver = prepared.resolvers[index]
            parts = [
                resolver.resolve(each, turned, maps.sample, move[None], skin_vertices)
                for each, turned, move, skin_vertices in zip(
                    vertices, turns, residual, frames.vertices[:, -1], strict=True
                )
            ]
            vertices, residual = (torch.stack(column) for column in zip(*parts, strict=True))
        past = state.past.followed_by(maps, vertices, now)
        return MotionGuidedState(past, now, seeds, residual), vertices


@dataclass(frozen=True)
class DecodedSpace:
    """The space of shapes of a garment (a GarmentSpace). size: length Z of its codes."""

    space: Space
    maps: GarmentMaps
    size: int

    @torch.no_grad()
    def encode(self, vertices: Tensor, transforms: Tensor) -> Tensor:
        """Garments (B, N, 3) m, world, on a body moved by transforms (B, J, 3, 4) -> codes (B, Z)."""
        texels = self.maps.positions(vertices)
        seeds = pose_seeds(self.maps.seeds, transforms).points
        offsets = local_offsets(self.maps, texels, transforms)
        return self.space.encode(shape_features(self.space, self.maps, texels, offsets, seeds))

    @torch.no_grad()
    def decode(self, codes: Tensor) -> Tensor:
        """Codes (B, Z), those of training about standard normal -> the garment at rest (B, N, 3), m."""
        return rest_shape(self.space, self.maps, codes)


def _resolver(garment: Garment, body: Body, device: torch.device) -> Resolver:
    """The residual optimization of a garment, on a device."""
    vertices, mesh = body.mesh.vertices.to(device), garment.mesh
    obstacle = Obstacle(to_device(make_collider(body), device), vertices)
    points = mesh.vertices.to(device)
    smooth = laplacian(mesh.faces, len(points)).to(device)
    return Resolver(obstacle, obstacle.contact_garment(points), smooth)


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
            f"{folder}: holds only the first stage, the shape space; "
            "continue with `uvcloth train motion_guided --resume`"
        )
    method: MotionGuided = restored(checkpoint, folder, MotionGuidedConfig, MotionGuided.untrained, Both)
    return replace(method, topology=str(checkpoint.notes.get("garment_topology", "")))


def faces_hash(garment: Garment) -> str:
    """Hash of a garment's faces, texture faces included; it differs between meshes of one name."""
    return fingerprint(garment.mesh.faces, garment.mesh.face_uvs)


def motion_guided_checkpoint(
    config: MotionGuidedConfig,
    tensors: dict[str, Tensor],
    body: Body,
    data: TrainingData,
    notes: dict[str, Any],
) -> Checkpoint:
    """The checkpoint of one stage or both, in half precision."""
    return Checkpoint(
        method="motion_guided",
        config=asdict(config),
        tensors={name: tensor.half() for name, tensor in tensors.items()},
        body=body_record(body),
        garments=(config.garment,),
        data=data,
        notes=notes,
    )


ENTRY = MethodEntry(PRESETS["fast"], MotionGuided.untrained, PRESETS, load_motion_guided)
