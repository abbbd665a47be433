"""Finish: the prediction of any method pulls the cages of its garments, and the solver moves them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import BodyFrames
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.methods.capabilities import (
    GarmentSpace,
    Representation,
    Wrapper,
    feed_back,
    garment_space,
    round_trip,
    with_contact,
)
from uvcloth.methods.method import Method, Traits
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import CagedOutfit, Moved, carry, moved, posed

PULL = 2.0
"""Frequency, 1/s, of the spring that pulls cages to a prediction: more of it freezes skirts."""


@dataclass(frozen=True)
class FinishState:
    """States of the method and of the solver."""

    guide: Any
    cloth: tuple[Moved, ...]


@dataclass(frozen=True)
class Finished(Wrapper, Representation):
    """A method whose garments are moved by the solver, on cages that are pulled to its prediction.

    pull: 1/s, frequency of the critically damped spring that pulls; 0 is physics alone, and the greater it
    is, the more the result is the prediction.
    """

    guide: Method
    physics: Physics
    pull: float
    name: str = ""
    traits = Traits(autoregressive=True, keeps_off_body=True, reads_fabric=True)

    @classmethod
    def of(cls, guide: Method, physics: Physics, pull: float = PULL) -> "Finished":
        """A method with the finish, under the name of the method."""
        return cls(with_contact(guide), physics, pull, guide.name)

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The reason of the method, or of the solver."""
        return self.guide.unsupported_reason(outfit) or self.physics.unsupported_reason(outfit)

    @property
    def parts(self) -> tuple[Method, ...]:
        """The method."""
        return (self.guide,)

    def prepare(self, outfit: Outfit, device: torch.device) -> tuple[Any, CagedOutfit]:
        """Prepare the method on a device, and the solver on the CPU."""
        return self.guide.prepare(outfit, device), self.physics.prepare(outfit, device)

    def init(self, prepared: tuple[Any, CagedOutfit], frames: BodyFrames) -> FinishState:
        """Start both."""
        guide, cages = prepared
        return FinishState(self.guide.init(guide, frames), self.physics.init(cages, frames))

    def step(
        self, prepared: tuple[Any, CagedOutfit], state: FinishState, frames: BodyFrames
    ) -> tuple[FinishState, tuple[Tensor, ...]]:
        """Garments (B, N, 3) m of the next frame of B rollouts."""
        guide, cages = prepared
        guided, raw = self.guide.step(guide, state.guide, frames)
        cloth, rows = [], []
        now = zip(state.cloth, posed(frames), strict=True)
        for place, (before, (transforms, vertices)) in enumerate(now):
            skinned = cages.skinned_cages(transforms)
            targets = _targets(cages, skinned, [garment[place].cpu() for garment in raw])
            after = moved(cages, before, cages.collider(vertices), targets, self.pull, frames.fps)
            after, garments = carry(cages, after, skinned, cages.skinned(transforms))
            cloth.append(after)
            rows.append(garments)
        finished = tuple(torch.stack(garments).to(raw[0].device) for garments in zip(*rows, strict=True))
        guided = feed_back(self.guide, guide, guided, finished)
        return FinishState(guided, tuple(cloth)), finished

    def displaced(self, prepared: tuple[Any, CagedOutfit], state: FinishState, shift: Tensor) -> FinishState:
        """Both displaced by (B, 3) m."""
        guide, cages = prepared
        return FinishState(
            self.guide.displaced(guide, state.guide, shift),
            self.physics.displaced(cages, state.cloth, shift),
        )

    def round_trip(
        self, prepared: tuple[Any, CagedOutfit], frames: BodyFrames, garments: tuple[Tensor, ...]
    ) -> tuple[Tensor, ...] | None:
        """Garments (B, N, 3) m in the representation of the method."""
        return round_trip(self.guide, prepared[0], frames, garments)

    def garment_space(self, garment: Garment, body: Body) -> GarmentSpace | None:
        """The space of the method."""
        return garment_space(self.guide, garment, body)


def _targets(
    cages: CagedOutfit, skinned: NDArray[np.float32], predicted: list[Tensor]
) -> NDArray[np.float32]:
    """Places (n, 3) m of the cages in predicted garments (N, 3) m; bands are held where they are skinned.

    skinned: (n, 3) m, the cages.
    """
    guided = torch.cat(
        [
            each.cage.at_cage(vertices[each.kept])
            for each, vertices in zip(cages.garments, predicted, strict=True)
        ]
    ).numpy()
    held = (cages.hold > 0)[:, None]
    return np.where(held, skinned, guided).astype(np.float32)
