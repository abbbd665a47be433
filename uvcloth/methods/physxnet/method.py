"""PhysXNet: maps of the body's motion in, maps of the garments' offsets out (section 3 of the paper)."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from rasterize.bake import scatter_map
from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import HISTORY, BodyFrames
from uvcloth.checkpoint import Checkpoint, TrainingData, body_record, restored
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.records import to_device
from uvcloth.methods.capabilities import Representation
from uvcloth.methods.method import Method, MethodEntry, Traits, for_inference, require_supported
from uvcloth.methods.physxnet.config import PRESETS, PhysXNetConfig
from uvcloth.methods.physxnet.maps import garment_vertices, motion_values, pose_values, template_offsets
from uvcloth.methods.physxnet.network import GarmentNet
from uvcloth.methods.physxnet.texels import (
    BodyTexels,
    GarmentDecoder,
    TemplateTexels,
    body_texels,
    build_decoder,
    template_texels,
)


@dataclass(frozen=True)
class PhysXNetPrepared:
    """An outfit on the maps: texels of the body and of each template, garments with their template's name.

    on_templates: whether every garment has the mesh of its template, so that maps can be written of it.
    """

    net: GarmentNet
    texels: BodyTexels
    templates: dict[str, TemplateTexels]
    garments: tuple[tuple[str, GarmentDecoder], ...]
    on_templates: bool = True


@dataclass(frozen=True)
class PhysXNetState:
    """The past that an autoregressive network sees in B rollouts.

    offsets: (B, history, 3 * templates, H, W) m, the last maps that it predicted, oldest first. motion: (B,
    HISTORY - 1, 6 or 0, P) velocity and acceleration of the body's texels in the frames before, oldest first.
    """

    offsets: Tensor
    motion: Tensor


@dataclass(frozen=True)
class PhysXNet(Method, Representation):
    """One pass of the network serves all garments of an outfit."""

    config: PhysXNetConfig
    net: GarmentNet
    name: str = "physxnet"

    @classmethod
    def untrained(cls, config: PhysXNetConfig) -> "PhysXNet":
        """The method with untrained weights and neutral statistics."""
        return cls(config, GarmentNet(config))

    @property
    def traits(self) -> Traits:
        """Autoregressive if the network sees its own last predictions."""
        return Traits(autoregressive=self.config.history > 0)

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The reason that it cannot dress an outfit: a garment without a template that has a decoder."""
        for garment in outfit.garments:
            if not self.config.decoder(garment.template):
                wanted = (
                    f"template {garment.template!r}" if garment.template else "a garment without template"
                )
                return (
                    f"garment {garment.name}: model {self.name} has no decoder for {wanted}, "
                    f"it has {', '.join(self.config.templates)}"
                )
        return ""

    def prepare(self, outfit: Outfit, device: torch.device) -> PhysXNetPrepared:
        """Fit the templates to the outfit's body at rest and project its garments onto their maps.

        Raises InputError for a garment whose template has no decoder.
        """
        require_supported(self, outfit)
        texels = body_texels(outfit.body, self.config.size)
        served = [name for garment in outfit.garments if (name := self.config.decoder(garment.template))]
        meshes = {name: template_mesh(name, outfit) for name in dict.fromkeys(served)}
        templates = {name: template_texels(name, mesh, outfit.body, texels) for name, mesh in meshes.items()}
        garments = tuple(
            (name, build_decoder(garment, templates[name], texels))
            for name, garment in zip(served, outfit.garments, strict=True)
        )
        on_device = to_device((texels, templates, garments), device)
        written = all(g.mesh is meshes[name] for name, g in zip(served, outfit.garments, strict=True))
        return PhysXNetPrepared(for_inference(self.net, device), *on_device, on_templates=written)

    @torch.no_grad()
    def init(self, prepared: PhysXNetPrepared, frames: BodyFrames) -> PhysXNetState | None:
        """Maps of zero offsets, and the motion of the body before the first frames of B rollouts."""
        config = self.config
        if not config.history:
            return None
        sheet = (config.history, 3 * len(config.templates), config.size, config.size)
        before = range(HISTORY - 1)
        return PhysXNetState(
            offsets=frames.transforms.new_zeros(len(frames), *sheet),
            motion=torch.stack([self._motion(prepared, frames, frame) for frame in before], dim=1),
        )

    @torch.no_grad()
    def step(
        self, prepared: PhysXNetPrepared, state: PhysXNetState | None, frames: BodyFrames
    ) -> tuple[PhysXNetState | None, tuple[Tensor, ...]]:
        """Offset maps of B frames, decoded to the vertices (B, N, 3) of each garment, m."""
        motion = self._motion(prepared, frames, HISTORY - 1)
        if state:
            motions = torch.cat([state.motion, motion[:, None]], dim=1)
        else:
            before = [self._motion(prepared, frames, frame) for frame in range(HISTORY - 1)]
            motions = torch.stack([*before, motion], dim=1)
        values = motions.flatten(1, 2)
        body_vertices, transforms = frames.vertices[:, -1], frames.transforms[:, -1]
        if self.config.pose:
            values = torch.cat([values, pose_values(prepared.texels, body_vertices, transforms)], dim=1)
        maps = scatter_map(values.transpose(1, 2), prepared.texels.sheet)
        if state:
            maps = torch.cat([maps, state.offsets.flatten(1, 2)], dim=1)
        predicted = prepared.net(maps)
        if state:
            state = PhysXNetState(feed_back_maps(state.offsets, predicted), motions[:, 1:])
        return state, self._decoded(prepared, predicted, body_vertices, transforms)

    def round_trip(
        self, prepared: PhysXNetPrepared, frames: BodyFrames, garments: tuple[Tensor, ...]
    ) -> tuple[Tensor, ...] | None:
        """Garments (B, N, 3) written to offset maps and read back; None where one has a mesh of its own."""
        if not prepared.on_templates:
            return None
        body_vertices, transforms = frames.vertices[:, -1], frames.transforms[:, -1]
        read = []
        for (name, decoder), vertices in zip(prepared.garments, garments, strict=True):
            template, texels = prepared.templates[name], prepared.texels
            parts = (self.config, texels, template, decoder)
            offsets = template_offsets(
                *parts, vertices=vertices, body_vertices=body_vertices, transforms=transforms
            )
            read.append(
                garment_vertices(*parts, offsets=offsets, body_vertices=body_vertices, transforms=transforms)
            )
        return tuple(read)

    def _motion(self, prepared: PhysXNetPrepared, frames: BodyFrames, frame: int) -> Tensor:
        """Velocity and acceleration of the texels in one frame of the body's history: (B, 6 or 0, P)."""
        return motion_values(
            self.config,
            prepared.texels,
            frames.velocity[:, frame],
            frames.acceleration[:, frame],
            frames.transforms[:, frame],
        )

    def _decoded(
        self, prepared: PhysXNetPrepared, predicted: Tensor, body_vertices: Tensor, transforms: Tensor
    ) -> tuple[Tensor, ...]:
        """The vertices (B, N, 3) of each garment of predicted maps (B, 3 * templates, H, W)."""
        garments = []
        for name, decoder in prepared.garments:
            template = prepared.templates[name]
            garments.append(
                garment_vertices(
                    self.config,
                    prepared.texels,
                    template,
                    decoder,
                    offsets=offsets_of(predicted, self.config.templates.index(name), template.pixels),
                    body_vertices=body_vertices,
                    transforms=transforms,
                )
            )
        return tuple(garments)


def feed_back_maps(history: Tensor, predicted: Tensor) -> Tensor:
    """The last offset maps (B, history, C, H, W), oldest first, and those predicted (B, C, H, W)."""
    return torch.cat([history[:, 1:], predicted[:, None]], dim=1)


def offsets_of(predicted: Tensor, index: int, pixels: Tensor) -> Tensor:
    """One template's texels of predicted maps (B, templates * 3, H, W): (B, Q, 3)."""
    return predicted[:, 3 * index : 3 * index + 3].flatten(2).index_select(2, pixels).transpose(1, 2)


def template_mesh(name: str, outfit: Outfit) -> Mesh:
    """A template at rest on an outfit's body: the outfit's own garment where it is the template itself."""
    from uvcloth.garments.templates import fit_template

    for garment in outfit.garments:
        if garment.source == "template" and garment.template == name:
            return garment.mesh
    return fit_template(name, outfit.body).mesh


def load_physxnet(checkpoint: Checkpoint, folder: Path) -> PhysXNet:
    """The trained method of a checkpoint. Raises InputError if weights and config do not fit each other."""
    return restored(checkpoint, folder, PhysXNetConfig, PhysXNet.untrained, lambda method: method.net)


def physxnet_checkpoint(
    method: PhysXNet, body: Body, data: TrainingData, notes: dict[str, Any]
) -> Checkpoint:
    """The checkpoint of a trained method, in half precision."""
    return Checkpoint(
        method="physxnet",
        config=asdict(method.config),
        tensors={
            name: tensor.half() if tensor.is_floating_point() else tensor
            for name, tensor in method.net.state_dict().items()
        },
        body=body_record(body),
        garments=method.config.templates,
        data=data,
        notes=notes,
    )


ENTRY = MethodEntry(PhysXNetConfig(), PhysXNet.untrained, PRESETS, load_physxnet)
