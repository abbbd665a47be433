"""A method trained on adults, for a body of another size: lengths are scaled to an adult's and back."""

from dataclasses import dataclass, replace
from typing import Any, NoReturn

import torch
from torch import Tensor

from uvcloth.bodies.body import Body, resized
from uvcloth.bodies.frames import BodyFrames
from uvcloth.bodies.stature import ADULTS, beside_adults, stature
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.methods.capabilities import (
    Feedback,
    FinishAware,
    GarmentSpace,
    Representation,
    Riggable,
    Swinging,
    Wrapper,
    before_finish,
    feed_back,
    garment_space,
    round_trip,
    with_dynamics,
)
from uvcloth.methods.method import Method, Traits


@dataclass(frozen=True)
class Resized(Wrapper, Feedback, FinishAware, Riggable, Swinging, Representation):
    """A method whose input, the body, its motion and its garments, is scaled by `factor`."""

    method: Method
    factor: float
    name: str

    @property
    def parts(self) -> tuple[Method, ...]:
        """The method."""
        return (self.method,)

    @property
    def traits(self) -> Traits:
        """Those of the method."""
        return self.method.traits

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The method's own reason that it cannot dress the outfit at its size."""
        return self.method.unsupported_reason(self._outfit(outfit))

    def before_finish(self) -> "Resized":
        """The method where a finish follows; the very same where that changes nothing."""
        method = before_finish(self.method)
        return self if method is self.method else replace(self, method=method)

    def with_dynamics(self, factor: float) -> "Resized":
        """The method with its dynamics scaled."""
        return replace(self, method=with_dynamics(self.method, factor))

    def prepare(self, outfit: Outfit, device: torch.device) -> Any:
        """Prepare the method for the outfit at its size."""
        return self.method.prepare(self._outfit(outfit), device)

    def init(self, prepared: Any, frames: BodyFrames) -> Any:
        """Start the method."""
        return self.method.init(prepared, self._frames(frames))

    def step(self, prepared: Any, state: Any, frames: BodyFrames) -> tuple[Any, tuple[Tensor, ...]]:
        """The next garments (B, N, 3), m, at the body's own size."""
        following, garments = self.method.step(prepared, state, self._frames(frames))
        return following, tuple(vertices / self.factor for vertices in garments)

    def feed_back(self, prepared: Any, state: Any, garments: tuple[Tensor, ...]) -> Any:
        """Feed garments (B, N, 3), m, back at the method's size."""
        return feed_back(self.method, prepared, state, self._scaled(garments))

    def displaced(self, prepared: Any, state: Any, shift: Tensor) -> Any:
        """The state with all places in it displaced by (B, 3) m."""
        return self.method.displaced(prepared, state, shift * self.factor)

    def round_trip(
        self, prepared: Any, frames: BodyFrames, garments: tuple[Tensor, ...]
    ) -> tuple[Tensor, ...] | None:
        """Garments (B, N, 3) m in the method's representation, at the size of the body."""
        read = round_trip(self.method, prepared, self._frames(frames), self._scaled(garments))
        return None if read is None else tuple(vertices / self.factor for vertices in read)

    def garment_space(self, garment: Garment, body: Body) -> GarmentSpace | None:
        """The space of the method, whose garments are of the size of the body."""
        space = garment_space(self.method, self._garment(garment), resized(body, self.factor))
        return space and ResizedSpace(space, self.factor)

    def as_rig(self, body: Body, garments: tuple[Garment, ...] = ()) -> NoReturn:
        """Raise InputError: the rig of the method is of another size than the body."""
        if rig := self.method.capability(Riggable):
            rig.as_rig(resized(body, self.factor), tuple(map(self._garment, garments)))
        raise InputError(
            f"model {self.name}: writes rigs for bodies of {ADULTS[0]} to {ADULTS[1]} m, body {body.name} "
            f"measures {stature(body):.2f} m"
        )

    def _outfit(self, outfit: Outfit) -> Outfit:
        under = None if outfit.under is None else self._garment(outfit.under)
        garments = tuple(map(self._garment, outfit.garments))
        return Outfit(resized(outfit.body, self.factor), garments, under)

    def _scaled(self, garments: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
        return tuple(vertices * self.factor for vertices in garments)

    def _garment(self, garment: Garment) -> Garment:
        return replace(garment, mesh=replace(garment.mesh, vertices=garment.mesh.vertices * self.factor))

    def _frames(self, frames: BodyFrames) -> BodyFrames:
        return replace(
            frames,
            body=resized(frames.body, self.factor),
            transforms=_scaled_transforms(frames.transforms, self.factor),
            vertices=frames.vertices * self.factor,
            velocity=frames.velocity * self.factor,
            acceleration=frames.acceleration * self.factor,
            under=None if frames.under is None else frames.under * self.factor,
        )


@dataclass(frozen=True)
class ResizedSpace:
    """A GarmentSpace of garments that are `factor` times as large inside it."""

    space: GarmentSpace
    factor: float

    @property
    def size(self) -> int:
        """Length Z of a code."""
        return self.space.size

    def encode(self, vertices: Tensor, transforms: Tensor) -> Tensor:
        """Codes (B, Z) of garments (B, N, 3), m, on a body moved by joint transforms (B, J, 3, 4)."""
        return self.space.encode(vertices * self.factor, _scaled_transforms(transforms, self.factor))

    def decode(self, codes: Tensor) -> Tensor:
        """Garments (B, N, 3) at rest, m, of codes (B, Z)."""
        return self.space.decode(codes) / self.factor


def _scaled_transforms(transforms: Tensor, factor: float) -> Tensor:
    """Transforms (..., 3, 4) of a body that is `factor` times as large."""
    return torch.cat([transforms[..., :3], transforms[..., 3:] * factor], dim=-1)


def for_size(method: Method, body: Body) -> Method:
    """A method trained on adults, for a body of any size: the very method for an adult's."""
    size = beside_adults(body)
    if size == 1.0:
        return method
    return Resized(method, 1.0 / size, method.name)
