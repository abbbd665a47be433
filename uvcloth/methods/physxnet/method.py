"""PhysXNet: maps of the body's motion in, maps of the garments' offsets out (section 3 of the paper).

Every idea beyond the paper is one field of `PhysXNetConfig`: an ablation is a list of one-line changes.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor, nn

from rasterize.bake import scatter_map
from rasterize.errors import InputError
from rasterize.gather import gather
from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import GRAVITY, HISTORY, BodyFrames
from uvcloth.checkpoint import Checkpoint, TrainingData, body_identity, restored
from uvcloth.garments.garment import LIKE, Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.rotations import rotate, rotate_back
from uvcloth.geometry.skinning import seen_from_root, skin_frames
from uvcloth.methods.physxnet.texels import (
    BodyTexels,
    GarmentDecoder,
    TemplateTexels,
    body_texels,
    build_decoder,
    template_texels,
)
from uvcloth.methods.physxnet.unet import UNet


@dataclass(frozen=True)
class PhysXNetConfig:
    """What the network sees, predicts and is made of; `PRESETS["paper"]` is the method as published."""

    size: int = 64
    """Height and width of every map, a multiple of 2 to the number of levels."""
    width: int = 32
    """Channels of the first encoder level; every next level doubles them, up to eight times."""
    levels: int = 3
    """Encoder and decoder levels (paper: 4); with fewer, less of the body is seen at once."""
    norm: Literal["batch", "group", "instance"] = "group"
    """Normalization layers."""
    upsample: Literal["transposed", "resize"] = "resize"
    """How decoders enlarge: transposed convolutions (paper) or convolution and bilinear enlargement."""
    dropout: float = 0.4
    """Share of the deepest level's channels dropped in training; 0 in the paper."""
    frame: Literal["world", "body"] = "body"
    """Axes of motion and offsets: the world's (paper) or the rest axes that turn with the body."""
    acceleration: Literal["plain", "specific_force"] = "specific_force"
    """Acceleration (paper) or acceleration minus gravity, which also says where down is."""
    pose: bool = True
    """Three more channels: where the body point is, seen from the root joint, against its place at rest."""
    anchor: Literal["body", "smooth_lbs"] = "smooth_lbs"
    """What offsets are measured from: the texel's body point (paper) or the smoothly skinned garment."""
    history: int = 2
    """How many of its own last offset maps the network sees; 0 remembers nothing (paper)."""
    scaling: Literal["min_max", "mean_std"] = "mean_std"
    """Each channel to [-1, 1] by its extremes (paper), or to zero mean and unit deviation."""
    reach: float = 4.0
    """Scaled inputs beyond this count as this: no motion is far from those seen. 0 sets no limit (paper)."""
    centre: Literal["channel", "texel"] = "texel"
    """Predicted offsets are measured from the middle of their channel (paper) or the mean of each texel."""
    templates: tuple[str, ...] = ("tops", "bottoms", "dress")
    """The templates with a decoder each."""

    def __post_init__(self) -> None:
        """Raises InputError if the levels do not halve the size evenly."""
        if self.size <= 0 or self.size % 2**self.levels:
            raise InputError(
                f"--size {self.size}: has to be a multiple of {2**self.levels} for --levels {self.levels}"
            )

    @property
    def inputs(self) -> int:
        """Channels of the network's input."""
        motion = HISTORY * 6 + (3 if self.pose else 0)
        return motion + self.history * 3 * len(self.templates)

    def decoder(self, template: str) -> str:
        """The template whose decoder serves a garment of this one: its own, else that of the one LIKE it."""
        return template if template in self.templates else LIKE.get(template, template)

    def create(self) -> "PhysXNet":
        """Build the method with untrained weights and neutral statistics."""
        return PhysXNet(self, GarmentNet(self))


PRESETS: dict[str, PhysXNetConfig] = {
    "default": PhysXNetConfig(),
    "paper": PhysXNetConfig(
        size=256,
        width=64,
        levels=4,
        norm="batch",
        upsample="transposed",
        dropout=0.0,
        frame="world",
        acceleration="plain",
        pose=False,
        anchor="body",
        history=0,
        scaling="min_max",
        reach=0.0,
        centre="channel",
    ),
    "tiny": PhysXNetConfig(size=32, width=8),
}


class GarmentNet(nn.Module):
    """The U-Net between maps in metres and seconds: scales what goes in and what comes out.

    The statistics are buffers, so that they are saved with the weights; output_shift is (channels, 1, 1) or,
    centred per texel, (channels, H, W).
    """

    input_shift: Tensor
    input_scale: Tensor
    output_shift: Tensor
    output_scale: Tensor

    def __init__(self, config: PhysXNetConfig) -> None:
        super().__init__()
        self.reach = config.reach
        outputs = 3 * len(config.templates)
        sheet = (config.size, config.size) if config.centre == "texel" else (1, 1)
        self.unet = UNet(
            inputs=config.inputs,
            decoders=len(config.templates),
            width=config.width,
            levels=config.levels,
            norm=config.norm,
            upsample=config.upsample,
            dropout=config.dropout,
        )
        self.register_buffer("input_shift", torch.zeros(config.inputs, 1, 1))
        self.register_buffer("input_scale", torch.ones(config.inputs, 1, 1))
        self.register_buffer("output_shift", torch.zeros(outputs, *sheet))
        self.register_buffer("output_scale", torch.ones(outputs, 1, 1))

    def scaled(self, maps: Tensor) -> Tensor:
        """The maps (B, inputs, H, W) as the network sees them."""
        scaled = (maps - self.input_shift) / self.input_scale
        return scaled.clamp(-self.reach, self.reach) if self.reach else scaled

    def forward(self, maps: Tensor) -> Tensor:
        """Motion (and history) maps (B, inputs, H, W) -> offset maps (B, templates * 3, H, W), m."""
        return self.unet(self.scaled(maps)).float() * self.output_scale + self.output_shift


def mirror(maps: Tensor) -> Tensor:
    """Left-right mirror image of maps of vectors (B, 3 n, H, W): the layout is symmetric about u = 0.5."""
    signs = maps.new_tensor([-1.0, 1.0, 1.0]).repeat(maps.shape[1] // 3)
    return maps.flip(-1) * signs[:, None, None]


def motion_values(
    config: PhysXNetConfig, texels: BodyTexels, velocity: Tensor, acceleration: Tensor, transforms: Tensor
) -> Tensor:
    """Velocity and acceleration of the texels' body points (eq. 6 and 7): (T, 6, P).

    velocity, acceleration: (T, V, 3) m/s and m/s2. transforms: (T, J, 3, 4).
    """
    v, a = texels.gather(velocity), texels.gather(acceleration)
    if config.acceleration == "specific_force":
        a = a - a.new_tensor(GRAVITY)
    if config.frame == "body":
        _, frames = skin_frames(texels.points, texels.weights, transforms)
        v, a = rotate_back(frames, v), rotate_back(frames, a)
    return torch.cat([v, a], dim=-1).transpose(1, 2)


def pose_values(texels: BodyTexels, vertices: Tensor, transforms: Tensor) -> Tensor:
    """Where the texels' body points are, seen from the root joint, against their rest: (T, 3, P), m.

    vertices: (T, V, 3). transforms: (T, J, 3, 4), the root joint first.
    """
    return (seen_from_root(texels.gather(vertices), transforms) - texels.points).transpose(1, 2)


def template_offsets(
    config: PhysXNetConfig,
    texels: BodyTexels,
    template: TemplateTexels,
    worn: GarmentDecoder,
    *,
    vertices: Tensor,
    body_vertices: Tensor,
    transforms: Tensor,
) -> Tensor:
    """A template's simulated vertices as values of its offset map: (T, Q, 3), m (eq. 8, or local offsets).

    vertices: (T, N, 3). body_vertices: (T, V, 3). transforms: (T, J, 3, 4).
    """
    if config.anchor == "body":
        origins, frames = body_anchors(texels, template, body_vertices, transforms)
        offsets = template.gather(vertices) - origins
        return rotate_back(frames, offsets) if config.frame == "body" else offsets
    origins, frames = skin_frames(worn.points, worn.smooth_weights, transforms)
    offsets = vertices - origins
    return template.gather(rotate_back(frames, offsets) if config.frame == "body" else offsets)


def garment_vertices(
    config: PhysXNetConfig,
    texels: BodyTexels,
    template: TemplateTexels,
    worn: GarmentDecoder,
    *,
    offsets: Tensor,
    body_vertices: Tensor,
    transforms: Tensor,
    sample: Callable[[Tensor], Tensor] | None = None,
) -> Tensor:
    """The inverse: a template's offsets (B, Q, 3) on any garment (eq. 9) -> its vertices (B, N, 3), m.

    Anchored on the smooth LBS reference, a garment keeps its own rest shape and takes over the change
    sampled; anchored on the body, it follows the template's surface and keeps what it had beside it at rest.
    sample: what serves for `worn.sample` where its gradient is wanted fast.
    """
    sample = sample or worn.sample
    local = config.frame == "body"
    if config.anchor == "body":
        origins, frames = body_anchors(texels, template, body_vertices, transforms)
        surface = sample(origins + (rotate(frames, offsets) if local else offsets))
        _, turned = skin_frames(worn.points, worn.weights, transforms)
        return surface + rotate(turned, worn.residual)
    origins, frames = skin_frames(worn.points, worn.smooth_weights, transforms)
    change = sample(offsets)
    return origins + (rotate(frames, change) if local else change)


def body_anchors(
    texels: BodyTexels, template: TemplateTexels, body_vertices: Tensor, transforms: Tensor
) -> tuple[Tensor, Tensor]:
    """Posed body points (B, Q, 3) of a template's texels, and the frames that turn with them (B, Q, 3, 3)."""
    seen = template.texels
    _, frames = skin_frames(texels.points[seen], texels.weights[seen], transforms)
    return gather(body_vertices, texels.corners[seen], texels.sheet.barycentrics[seen]), frames


@dataclass(frozen=True)
class PhysXNetState:
    """The outfit on the maps. history: (history, 3 * templates, H, W) last offset maps, oldest first."""

    texels: BodyTexels
    templates: dict[str, TemplateTexels]
    garments: tuple[tuple[str, GarmentDecoder], ...]
    history: Tensor


@dataclass(frozen=True)
class PhysXNet:
    """A Method: one pass of the network serves all garments of an outfit."""

    config: PhysXNetConfig
    net: GarmentNet
    name: str = "physxnet"
    quasi_static: bool = False

    @property
    def autoregressive(self) -> bool:
        """Whether the network sees its own last predictions."""
        return self.config.history > 0

    def unsupported_reason(self, outfit: Outfit) -> str:
        """It dresses what a template with a decoder serves."""
        for garment in outfit.garments:
            if self.config.decoder(garment.template) not in self.config.templates:
                return (
                    f"garment {garment.name}: model {self.name} has no decoder for template "
                    f"{garment.template!r}, it has {', '.join(self.config.templates)}"
                )
        return ""

    def start(self, outfit: Outfit, frames: BodyFrames) -> PhysXNetState:
        """Dress the outfit's body in the templates at rest and project its garments onto their maps.

        Raises InputError for a garment whose template has no decoder.
        """
        if unsupported_reason := self.unsupported_reason(outfit):
            raise InputError(unsupported_reason)
        texels = body_texels(outfit.body, self.config.size)
        served = [self.config.decoder(garment.template) for garment in outfit.garments]
        templates = {
            name: template_texels(name, template_mesh(name, outfit), outfit.body, texels)
            for name in dict.fromkeys(served)
        }
        garments = tuple(
            (name, build_decoder(garment, templates[name], texels))
            for name, garment in zip(served, outfit.garments, strict=True)
        )
        sheet = (self.config.history, 3 * len(self.config.templates), self.config.size, self.config.size)
        return PhysXNetState(texels, templates, garments, torch.zeros(sheet))

    @torch.no_grad()
    def step(self, state: PhysXNetState, frames: BodyFrames) -> tuple[PhysXNetState, tuple[Tensor, ...]]:
        """Offset maps of B frames, decoded to the vertices (B, N, 3) of each garment, m."""
        config, texels = self.config, state.texels
        self.net.eval()
        maps = scatter_map(self._motion(texels, frames).transpose(1, 2), texels.sheet)
        if config.history:
            past = state.history.flatten(0, 1).expand(len(maps), -1, -1, -1)
            maps = torch.cat([maps, past], dim=1)
        predicted = self.net(maps)
        if config.history:
            state = replace(state, history=torch.cat([state.history, predicted[-1:]])[-config.history :])
        flat = predicted.flatten(2)
        body_vertices, transforms = frames.vertices[:, -1], frames.transforms[:, -1]
        moved = []
        for name, worn in state.garments:
            template = state.templates[name]
            first = 3 * config.templates.index(name)
            offsets = flat[:, first : first + 3].index_select(2, template.pixels).transpose(1, 2)
            moved.append(
                garment_vertices(
                    config,
                    texels,
                    template,
                    worn,
                    offsets=offsets,
                    body_vertices=body_vertices,
                    transforms=transforms,
                )
            )
        return state, tuple(moved)

    def observe(self, state: PhysXNetState, garments: tuple[Tensor, ...]) -> PhysXNetState:
        """It remembers its maps as predicted: contact is no part of its training."""
        return state

    def _motion(self, texels: BodyTexels, frames: BodyFrames) -> Tensor:
        """The network's motion channels at the texels: (B, C, P).

        Frames follow each other, so that the histories of B frames are B + HISTORY - 1 frames in all.
        """

        def run(values: Tensor) -> Tensor:
            return torch.cat([values[0, :-1], values[:, -1]])

        motion = motion_values(
            self.config, texels, run(frames.velocity), run(frames.acceleration), run(frames.transforms)
        )
        motion = motion.unfold(0, HISTORY, 1).movedim(-1, 1).flatten(1, 2)
        if not self.config.pose:
            return motion
        pose = pose_values(texels, frames.vertices[:, -1], frames.transforms[:, -1])
        return torch.cat([motion, pose], dim=1)


def template_mesh(name: str, outfit: Outfit) -> Mesh:
    """A template at rest on an outfit's body: the outfit's own garment where it is the template itself."""
    from uvcloth.garments.templates import fit_template, load_template

    faces = load_template(name).faces
    for garment in outfit.garments:
        if garment.name == garment.template == name and torch.equal(garment.mesh.faces, faces):
            return garment.mesh
    return fit_template(name, outfit.body).mesh


def load_physxnet(checkpoint: Checkpoint, folder: Path) -> PhysXNet:
    """The trained method of a checkpoint. Raises InputError if weights and config do not fit each other."""
    return restored(checkpoint, folder, PhysXNetConfig, lambda method: method.net)


def physxnet_checkpoint(
    method: PhysXNet, body: Body, data: TrainingData, notes: dict[str, Any]
) -> Checkpoint:
    """What a trained method saves."""
    return Checkpoint(
        method=method.name,
        config=asdict(method.config),
        tensors=method.net.state_dict(),
        body=body_identity(body),
        templates=method.config.templates,
        data=data,
        notes=notes,
    )
