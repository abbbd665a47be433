"""Physics: the cloth solver on cages, in real time, for any garments in one solve, without training."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.bodies.frames import BodyFrames
from uvcloth.errors import InputError
from uvcloth.garments.band import unheld_reason
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.garment import Outfit
from uvcloth.methods.capabilities import Representation
from uvcloth.methods.method import Method, MethodEntry, Traits
from uvcloth.methods.physics.bake import baked_sections
from uvcloth.methods.physics.outfit import CagedOutfit, PhysicsConfig, make_caged_outfit
from uvcloth.player.outfit import Cloth
from uvcloth.player.outfit import Outfit as BakedOutfit
from uvcloth.player.sections import pack


@dataclass(frozen=True)
class BakedPhysics:
    """An outfit on cages, and the same as the runtime reads it."""

    caged: CagedOutfit
    baked: BakedOutfit


@dataclass(frozen=True)
class Worn:
    """Cloth of one rollout, in the world: `memory` is all that it remembers, whatever moved `cloth` since."""

    cloth: Cloth
    memory: NDArray[np.uint8]

    @classmethod
    def after(cls, cloth: Cloth) -> Self:
        """Cloth as it is now."""
        return cls(cloth, cloth.save())

    def recalled(self) -> Cloth:
        """The cloth as it was then."""
        self.cloth.restore(self.memory)
        return self.cloth


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

    def prepare(self, outfit: Outfit, device: torch.device) -> BakedPhysics:
        """Make the cages and bake them, on the CPU. Raises InputError as `make_caged_outfit` does."""
        caged = make_caged_outfit(outfit, self.config)
        return BakedPhysics(caged, BakedOutfit(pack(baked_sections(outfit, caged))))

    def init(self, prepared: BakedPhysics, frames: BodyFrames) -> tuple[Worn, ...]:
        """Let cloth settle on the bodies as they stand in the frames. Raises InputError if it cannot."""
        return tuple(dressed(prepared, joints) for joints in frames.joints.numpy())

    def step(
        self, prepared: BakedPhysics, state: tuple[Worn, ...], frames: BodyFrames
    ) -> tuple[tuple[Worn, ...], tuple[Tensor, ...]]:
        """Garments (B, N, 3) m of the next frame of B rollouts.

        Raises InputError for a body that is too fast for cloth.
        """
        following, rows = [], []
        for before, joints, origin in zip(state, frames.joints.numpy(), frames.origin, strict=True):
            cloth = before.recalled()
            moved_on(cloth, joints, frames.fps)
            following.append(Worn.after(cloth))
            rows.append(shown(cloth, origin))
        device = frames.vertices.device
        return tuple(following), tuple(torch.stack(each).to(device) for each in zip(*rows, strict=True))

    def round_trip(
        self, prepared: BakedPhysics, frames: BodyFrames, garments: tuple[Tensor, ...]
    ) -> tuple[Tensor, ...]:
        """Garments (B, N, 3) m as cages that lie in them carry them."""
        return prepared.caged.represented(frames.transforms[:, -1], garments)


def dressed(prepared: BakedPhysics, joints: NDArray[np.float64]) -> Worn:
    """Cloth at rest on a body that went from its rest pose to that of joints (J, 3, 4).

    Raises InputError if it finds no rest.
    """
    cloth = Cloth(prepared.baked)
    with as_input_errors():
        cloth.start(joints)
    return Worn.after(cloth)


def moved_on(cloth: Cloth, joints: NDArray[np.float64], fps: float) -> None:
    """Move cloth on to a frame. Raises InputError as the runtime says it."""
    with as_input_errors():
        cloth.step(joints, 1.0 / fps)


def shown(cloth: Cloth, origin: Tensor) -> tuple[Tensor, ...]:
    """Garments (N, 3) m around an origin, (3,) float64 m."""
    garments = (torch.from_numpy(cloth.vertices(each)) for each in range(len(cloth.outfit.garments)))
    return tuple((vertices - origin).float() for vertices in garments)


@contextmanager
def as_input_errors() -> Iterator[None]:
    """Raise what the runtime refuses as InputError."""
    try:
        yield
    except ValueError as error:
        raise InputError(str(error)) from error


ENTRY = MethodEntry(
    PhysicsConfig(), Physics, presets={quality: PhysicsConfig(quality) for quality in QUALITIES}
)
