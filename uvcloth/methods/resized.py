"""A method that learned on adults, for a body of another size: lengths become an adult's and back."""

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from uvcloth.bodies.body import Body, resized
from uvcloth.bodies.frames import BodyFrames
from uvcloth.bodies.stature import ADULTS, beside_adults, stature
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.methods.method import Method
from uvcloth.methods.rig import PoseRig


@dataclass(frozen=True)
class Resized(Method):
    """A method that sees the body, its motion and its clothes `factor` times as long as they are."""

    method: Method
    factor: float
    name: str
    autoregressive: bool = False
    quasi_static: bool = False
    is_baseline: bool = False

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The method's own reason that it cannot dress the outfit at its size."""
        return self.method.unsupported_reason(self._outfit(outfit))

    def reads_fabric(self) -> bool:
        """True if the method reads the fabric."""
        return self.method.reads_fabric()

    def with_contact(self) -> "Resized":
        """The method where contact follows; the very same where that changes nothing."""
        method = self.method.with_contact()
        return self if method is self.method else replace(self, method=method)

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
        return self.method.feed_back(prepared, state, tuple(vertices * self.factor for vertices in garments))

    def displaced(self, prepared: Any, state: Any, shift: Tensor) -> Any:
        """The state with all places in it displaced by (B, 3) m."""
        return self.method.displaced(prepared, state, shift * self.factor)

    def as_rig(self, body: Body, garments: tuple[Garment, ...] = ()) -> PoseRig | None:
        """None. Raises InputError where the method is a rig: it would be of another size."""
        self.method.as_rig(resized(body, self.factor), tuple(map(self._garment, garments)))
        raise InputError(
            f"model {self.name}: writes rigs for bodies of {ADULTS[0]} to {ADULTS[1]} m, body {body.name} "
            f"measures {stature(body):.2f} m"
        )

    def _outfit(self, outfit: Outfit) -> Outfit:
        under = None if outfit.under is None else self._garment(outfit.under)
        garments = tuple(map(self._garment, outfit.garments))
        return Outfit(resized(outfit.body, self.factor), garments, under)

    def _garment(self, garment: Garment) -> Garment:
        return replace(garment, mesh=replace(garment.mesh, vertices=garment.mesh.vertices * self.factor))

    def _frames(self, frames: BodyFrames) -> BodyFrames:
        transforms = frames.transforms.clone()
        transforms[..., 3] *= self.factor
        return replace(
            frames,
            body=resized(frames.body, self.factor),
            transforms=transforms,
            vertices=frames.vertices * self.factor,
            velocity=frames.velocity * self.factor,
            acceleration=frames.acceleration * self.factor,
            under=None if frames.under is None else frames.under * self.factor,
        )


def for_size(method: Method, body: Body) -> Method:
    """A method that learned on adults, made one for a body of any size: itself for an adult's."""
    size = beside_adults(body)
    if size == 1.0:
        return method
    own = (method.name, method.autoregressive, method.quasi_static, method.is_baseline)
    return Resized(method, 1.0 / size, *own)
