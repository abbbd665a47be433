"""Finishes: the prediction of any method pulls the cages of its garments, and the solver moves them."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import BodyFrames
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.methods.capabilities import (
    GarmentSpace,
    Representation,
    Wrapper,
    before_finish,
    feed_back,
    garment_space,
)
from uvcloth.methods.finish_names import FINISHES, FinishName
from uvcloth.methods.lbs import LBSConfig, create_lbs
from uvcloth.methods.method import Method, Traits
from uvcloth.methods.physics.dressed import ClothMemory, dressed, move_on, settle, shown
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import CagedOutfit
from uvcloth.player.outfit import Cloth

PULL = 2.0
"""Frequency, 1/s, of the spring that pulls cages to a prediction: a higher one freezes skirts."""


@dataclass(frozen=True)
class FinishState:
    """States of the method and of the solver."""

    guide: Any
    cloth: tuple[ClothMemory, ...]


@dataclass(frozen=True)
class Finish(Wrapper, Representation):
    """A method whose garments the solver moves, on cages that are pulled to its prediction.

    pull: 1/s, frequency of the spring that pulls; 0 is physics alone, and the higher it is, the closer the
    result is to the prediction. A garment whose prediction is not finite is not moved, so that the rollout's
    error names it.
    """

    guide: Method
    physics: Physics
    pull: float
    name: str

    @classmethod
    def of(cls, guide: Method, physics: Physics, pull: float = PULL) -> Self:
        """A method with the finish, under the name of the method."""
        return cls(before_finish(guide), physics, pull, guide.name)

    @property
    def parts(self) -> tuple[Method, ...]:
        """The method and the solver."""
        return (self.guide, self.physics)

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The reason of the method, or of the solver."""
        return self.guide.unsupported_reason(outfit) or self.physics.unsupported_reason(outfit)

    def prepare(self, outfit: Outfit, device: torch.device) -> tuple[Any, CagedOutfit]:
        """Prepare the method on a device, and the solver on the CPU."""
        return self.guide.prepare(outfit, device), self.physics.prepare(outfit, device)

    def round_trip(
        self, prepared: tuple[Any, CagedOutfit], frames: BodyFrames, garments: tuple[Tensor, ...]
    ) -> tuple[Tensor, ...] | None:
        """Garments (B, N, 3) m as the cages carry them: what the method cannot show, the solver may add."""
        return self.physics.round_trip(prepared[1], frames, garments)

    def garment_space(self, garment: Garment, body: Body) -> GarmentSpace | None:
        """The space of the method."""
        return garment_space(self.guide, garment, body)


@dataclass(frozen=True)
class Finished(Finish):
    """The dynamic finish: garments keep their motion from frame to frame."""

    traits = Traits(autoregressive=True, keeps_off_body=True, reads_fabric=True)

    def init(self, prepared: tuple[Any, CagedOutfit], frames: BodyFrames) -> FinishState:
        """Start the method and the solver."""
        guide, cages = prepared
        return FinishState(self.guide.init(guide, frames), self.physics.init(cages, frames))

    def step(
        self, prepared: tuple[Any, CagedOutfit], state: FinishState, frames: BodyFrames
    ) -> tuple[FinishState, tuple[Tensor, ...]]:
        """Garments (B, N, 3) m of the next frame of B rollouts."""
        guide, cages = prepared
        guided, raw = self.guide.step(guide, state.guide, frames)
        following, rows = [], []
        for place, before in enumerate(state.cloth):
            cloth, predicted = before.recalled(), [garment[place].cpu() for garment in raw]
            cloth.pull(_targets(cages, frames, place, predicted), self.pull)
            move_on(cloth, frames.joints[place], frames.fps)
            following.append(ClothMemory.after(cloth))
            rows.append(_where_finite(predicted, shown(cloth, frames.origin[place])))
        finished = tuple(torch.stack(garments).to(raw[0].device) for garments in zip(*rows, strict=True))
        guided = feed_back(self.guide, guide, guided, finished)
        return FinishState(guided, tuple(following)), finished

    def displaced(self, prepared: tuple[Any, CagedOutfit], state: FinishState, shift: Tensor) -> FinishState:
        """The state of the method displaced by (B, 3) m: that of the solver is in the world."""
        return replace(state, guide=self.guide.displaced(prepared[0], state.guide, shift))


@dataclass(frozen=True)
class StaticFinish(Finish):
    """The static finish: garments come to rest in each pose, whatever was before, for poses and previews.

    Cloth starts at the prediction. Without a pull it is of physics alone, and starts as `dressed` does.
    """

    @property
    def traits(self) -> Traits:
        """Those of the method: the solver remembers nothing."""
        return replace(self.guide.traits, keeps_off_body=True, reads_fabric=True, is_baseline=False)

    def init(self, prepared: tuple[Any, CagedOutfit], frames: BodyFrames) -> Any:
        """State of the method alone."""
        return self.guide.init(prepared[0], frames)

    def step(
        self, prepared: tuple[Any, CagedOutfit], state: Any, frames: BodyFrames
    ) -> tuple[Any, tuple[Tensor, ...]]:
        """Garments (B, N, 3) m of B poses; a method remembers its own predictions."""
        guide, cages = prepared
        state, raw = self.guide.step(guide, state, frames)
        rows = []
        for place, joints in enumerate(frames.joints):
            predicted = [garment[place].cpu() for garment in raw]
            if self.pull > 0.0:
                cloth = Cloth(cages.baked)
                cloth.pull(_targets(cages, frames, place, predicted), self.pull)
                settle(cloth, joints)
            else:
                cloth = dressed(cages, joints)
            rows.append(_where_finite(predicted, shown(cloth, frames.origin[place])))
        return state, tuple(torch.stack(garments).to(raw[0].device) for garments in zip(*rows, strict=True))

    def displaced(self, prepared: tuple[Any, CagedOutfit], state: Any, shift: Tensor) -> Any:
        """The state of the method displaced by (B, 3) m."""
        return self.guide.displaced(prepared[0], state, shift)


def finished(
    method: Method, outfit: Outfit, finish: FinishName | None, physics: Physics
) -> tuple[Method, bool]:
    """The method with its finish for an outfit, and whether clearing comes after it.

    finish: None for the usual one, which is dynamic for trained methods if the solver can move the outfit,
    and clear for other outfits, for baselines and for methods with physics. Raises InputError for an
    unknown name.
    """
    if finish is not None and finish not in FINISHES:
        raise InputError(f"--finish {finish}: expected one of {', '.join(FINISHES)}")
    if finish is None:
        parts = method.parts if isinstance(method, Wrapper) else (method,)
        trained = not any(isinstance(part, Physics) or part.traits.is_baseline for part in parts)
        finish = "dynamic" if trained and not physics.unsupported_reason(outfit) else "clear"
    return with_finish(method, finish, physics), finish != "none"


def with_finish(method: Method, finish: FinishName, physics: Physics) -> Method:
    """The method with a dynamic or static finish of the solver; otherwise, as dynamic physics, itself."""
    solves = isinstance(method, Physics)
    if finish == "static":
        return static_physics(physics) if solves else StaticFinish.of(method, physics)
    return Finished.of(method, physics) if finish == "dynamic" and not solves else method


def static_physics(physics: Physics) -> StaticFinish:
    """The solver with the static finish: garments come to rest from the smoothly skinned ones."""
    return StaticFinish(create_lbs(LBSConfig(smooth=True)), physics, 0.0, physics.name)


def _where_finite(predicted: list[Tensor], garments: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    """Garments (N, 3) m, or the predicted ones where those are not finite."""
    pairs = zip(predicted, garments, strict=True)
    return tuple(garment if torch.isfinite(guess).all() else guess for guess, garment in pairs)


def _targets(
    cages: CagedOutfit, frames: BodyFrames, place: int, predicted: list[Tensor]
) -> NDArray[np.float64]:
    """Places (n, 3) m, in the world, of the cages in predicted garments (N, 3) m of one of the frames.

    Where a prediction is not finite they are the skinned cages.
    """
    guided = torch.cat(
        [
            each.cage.at_cage(vertices[each.mesh.kept])
            for each, vertices in zip(cages.garments, predicted, strict=True)
        ]
    )
    if not torch.isfinite(guided).all():
        skinned = cages.skinned_cages(frames.transforms[place, -1].cpu())
        guided = torch.where(torch.isfinite(guided).all(1, keepdim=True), guided, skinned)
    return (guided.double() + frames.origin[place]).numpy()
