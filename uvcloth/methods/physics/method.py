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
from uvcloth.methods.physics.dressed import ClothMemory, dressed, move_on, shown
from uvcloth.methods.physics.outfit import CagedOutfit, PhysicsConfig, make_caged_outfit


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
        """Make the cages, on the CPU. Raises InputError as `make_caged_outfit` does."""
        return make_caged_outfit(outfit, self.config)

    def init(self, prepared: CagedOutfit, frames: BodyFrames) -> tuple[ClothMemory, ...]:
        """Let cloth settle on the bodies as they stand in the frames. Raises InputError if it cannot."""
        return tuple(ClothMemory.after(dressed(prepared, joints)) for joints in frames.joints)

    def step(
        self, prepared: CagedOutfit, state: tuple[ClothMemory, ...], frames: BodyFrames
    ) -> tuple[tuple[ClothMemory, ...], tuple[Tensor, ...]]:
        """Garments (B, N, 3) m of the next frame of B rollouts.

        Raises InputError for a body that is too fast for cloth.
        """
        following, rows = [], []
        for before, joints, origin in zip(state, frames.joints, frames.origin, strict=True):
            cloth = before.recalled()
            move_on(cloth, joints, frames.fps)
            following.append(ClothMemory.after(cloth))
            rows.append(shown(cloth, origin))
        device = frames.vertices.device
        return tuple(following), tuple(torch.stack(each).to(device) for each in zip(*rows, strict=True))

    def round_trip(
        self, prepared: CagedOutfit, frames: BodyFrames, garments: tuple[Tensor, ...]
    ) -> tuple[Tensor, ...]:
        """Garments (B, N, 3) m as cages that lie in them carry them."""
        return prepared.represented(frames.transforms[:, -1], garments)


ENTRY = MethodEntry(
    PhysicsConfig(), Physics, presets={quality: PhysicsConfig(quality) for quality in QUALITIES}
)
