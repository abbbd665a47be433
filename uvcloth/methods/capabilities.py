"""Capabilities that only some methods have, asked for by type: `method.capability(Riggable)`."""

from abc import ABC, abstractmethod
from typing import Any, Protocol, TypeVar

from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import BodyFrames
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.methods.method import Method
from uvcloth.methods.rig import BlendRig

Capability = TypeVar("Capability")


class Feedback(ABC):
    """Use of garments after the finish, or of simulated ones, in the place of those predicted last."""

    @abstractmethod
    def feed_back(self, prepared: Any, state: Any, garments: tuple[Tensor, ...]) -> Any:
        """The state with the last predicted garments replaced by others, (B, N, 3) m each.

        Returns the very state where that changes nothing.
        """


class FinishAware(ABC):
    """Parts that only do what a finish does."""

    @abstractmethod
    def before_finish(self) -> Method:
        """The method without these parts, for a rollout with a finish; the very method if it has none."""


class Riggable(ABC):
    """Blend weights and blend shapes, which engines play."""

    @abstractmethod
    def as_rig(self, body: Body, garments: tuple[Garment, ...] = ()) -> BlendRig:
        """The rig of garments on a body.

        garments: of that body, the innermost first, for a method that rigs any outfit; a method of one outfit
        needs none. Raises InputError for another body or other garments than those of the method.
        """


class Swinging(ABC):
    """Motion of garments beyond what the pose asks for, as a part that can be scaled."""

    @abstractmethod
    def with_dynamics(self, factor: float) -> Method:
        """The method with that part times a factor: 0 shows garments as they rest in each pose."""


class Representation(ABC):
    """A representation, such as maps or codes, that cannot show every garment."""

    @abstractmethod
    def round_trip(
        self, prepared: Any, frames: BodyFrames, garments: tuple[Tensor, ...]
    ) -> tuple[Tensor, ...] | None:
        """Simulated garments (B, N, 3) m written in the representation and read back: the least error of the
        method. None if it represents these garments exactly, or has no representation of one of them.
        """

    def garment_space(self, garment: Garment, body: Body) -> "GarmentSpace | None":
        """The space of shapes from which it draws a garment; None if it has none."""
        return None


CAPABILITIES: tuple[type, ...] = (Feedback, FinishAware, Riggable, Swinging, Representation)
"""Every capability: a wrapper is tested for each."""


class GarmentSpace(Protocol):
    """Garments decoded from codes that are spread like a standard normal distribution."""

    @property
    def size(self) -> int:
        """Length Z of a code."""
        ...

    def encode(self, vertices: Tensor, transforms: Tensor) -> Tensor:
        """Codes (B, Z) of garments (B, N, 3), m, on a body moved by joint transforms (B, J, 3, 4)."""
        ...

    def decode(self, codes: Tensor) -> Tensor:
        """Garments (B, N, 3) at rest, m, of codes (B, Z)."""
        ...


class Wrapper(Method):
    """A method made of others.

    It implements each capability that it can forward, and has those of them that one of its parts has.
    """

    @property
    def parts(self) -> tuple[Method, ...]:
        """The methods inside."""
        raise NotImplementedError

    def capability(self, kind: type[Capability]) -> Capability | None:
        """This method as a kind that one of its parts is too; None if none is."""
        has = any(part.capability(kind) is not None for part in self.parts)
        return super().capability(kind) if has else None


def feed_back(method: Method, prepared: Any, state: Any, garments: tuple[Tensor, ...]) -> Any:
    """The state of any method after feedback, see `Feedback`; the very state where that changes nothing."""
    able = method.capability(Feedback)
    return able.feed_back(prepared, state, garments) if able else state


def before_finish(method: Method) -> Method:
    """Any method without the parts that only do what a finish does; the very method if it has none."""
    able = method.capability(FinishAware)
    return able.before_finish() if able else method


def with_dynamics(method: Method, factor: float) -> Method:
    """Any method with its dynamics scaled, see `Swinging`. Raises InputError for one that cannot."""
    able = method.capability(Swinging)
    if able is None:
        raise InputError(
            f"--dynamics {factor:g}: model {method.name} cannot scale its motion, recurrent models can"
        )
    return able.with_dynamics(factor)


def round_trip(
    method: Method, prepared: Any, frames: BodyFrames, garments: tuple[Tensor, ...]
) -> tuple[Tensor, ...] | None:
    """Garments in the representation of any method, see `Representation`; None if it has none."""
    able = method.capability(Representation)
    return able.round_trip(prepared, frames, garments) if able else None


def garment_space(method: Method, garment: Garment, body: Body) -> GarmentSpace | None:
    """The space of shapes from which any method draws a garment; None if it has none."""
    able = method.capability(Representation)
    return able.garment_space(garment, body) if able else None
