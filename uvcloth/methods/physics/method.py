"""Physics: the cloth solver on cages, in real time, for any garments in one solve, without training."""

from dataclasses import dataclass, field

import torch
from torch import Tensor

from uvcloth.bodies.frames import BodyFrames
from uvcloth.garments.band import unheld_reason
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Outfit
from uvcloth.methods.capabilities import Representation
from uvcloth.methods.method import Method, MethodEntry, Traits
from uvcloth.methods.physics.outfit import (
    CagedOutfit,
    CagedState,
    PhysicsConfig,
    carry,
    dressed,
    make_caged_outfit,
    next_frame,
    posed,
)


@dataclass(frozen=True)
class Physics(Method, Representation):
    """The cloth solver on cages of the garments."""

    config: PhysicsConfig = field(default_factory=PhysicsConfig)
    name: str = "physics"
    traits = Traits(autoregressive=True, keeps_off_body=True, reads_fabric=True)

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The reason that a garment cannot be solved."""
        fault = unheld_reason(outfit)
        return f"{fault}; use --model physxnet or lbs_smooth" if fault else ""

    def prepare(self, outfit: Outfit, device: torch.device) -> CagedOutfit:
        """Make the cages and their solver, on the CPU. Raises InputError as `make_caged_outfit` does."""
        return make_caged_outfit(outfit, self.config)

    def init(self, prepared: CagedOutfit, frames: BodyFrames) -> tuple[CagedState, ...]:
        """Let cloth settle on the bodies as they stand in the frames."""
        return tuple(
            dressed(prepared, frames.body, transforms) for transforms in frames.transforms[:, -1].cpu()
        )

    def step(
        self, prepared: CagedOutfit, state: tuple[CagedState, ...], frames: BodyFrames
    ) -> tuple[tuple[CagedState, ...], tuple[Tensor, ...]]:
        """Garments (B, N, 3) m of the next frame of B rollouts."""
        following, rows = [], []
        for before, (transforms, vertices) in zip(state, posed(frames), strict=True):
            targets = prepared.skinned_cages(transforms)
            after = next_frame(prepared, before, prepared.collider(vertices), targets, 0.0, frames.fps)
            after, garments = carry(prepared, after, targets, prepared.skinned(transforms), vertices)
            following.append(after)
            rows.append(garments)
        device = frames.vertices.device
        return tuple(following), tuple(torch.stack(each).to(device) for each in zip(*rows, strict=True))

    def round_trip(
        self, prepared: CagedOutfit, frames: BodyFrames, garments: tuple[Tensor, ...]
    ) -> tuple[Tensor, ...]:
        """Garments (B, N, 3) m as cages that lie in them carry them."""
        return prepared.represented(frames.transforms[:, -1], garments)

    def displaced(
        self, prepared: CagedOutfit, state: tuple[CagedState, ...], shift: Tensor
    ) -> tuple[CagedState, ...]:
        """The rollouts displaced by (B, 3) m."""
        ways = shift.double().cpu().numpy()
        return tuple(each.displaced(way) for each, way in zip(state, ways, strict=True))


ENTRY = MethodEntry(
    PhysicsConfig(), Physics, presets={quality: PhysicsConfig(quality) for quality in QUALITIES}
)
