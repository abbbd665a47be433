"""The protocol of a garment method: prepare an outfit once, then step frame after frame."""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import BodyFrames
from uvcloth.checkpoint import Checkpoint
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.methods.rig import PoseRig


class Method(Protocol):
    """Interface to rollout, evaluation and export; a class that derives from it inherits the defaults.

    A method holds its settings and weights and never changes. What it works out for an outfit is `Prepared`,
    shared by all rollouts; what it keeps from frame to frame is `State`, of its own kind, passed along.
    """

    name: str
    """The name in tables and messages."""
    autoregressive: bool = False
    """True if the state holds what was predicted before. Then the B frames of a step are those of B
    rollouts side by side; if not, any B frames."""
    quasi_static: bool = False
    """True if a frame depends on its own pose alone, however fast the body came there."""
    keeps_off_body: bool = False
    """True if its garments are off the body and off each other as it predicts them: contact is left out."""
    is_baseline: bool = False
    """True if other methods are measured against it."""

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The reason that it cannot dress an outfit, in words that name garment and model; "" if it can."""
        return ""

    def reads_fabric(self) -> bool:
        """True if garments of other fabrics move otherwise."""
        return False

    def prepare(self, outfit: Outfit, device: torch.device) -> Any:
        """Compute what depends on the outfit alone (ray casts, layouts, weights on the device): Prepared."""
        ...

    def init(self, prepared: Any, frames: BodyFrames) -> Any:
        """Start from the first frames of B rollouts: State."""
        return ()

    def step(self, prepared: Any, state: Any, frames: BodyFrames) -> tuple[Any, tuple[Tensor, ...]]:
        """Predict B frames: the next state and, per garment, vertices (B, N, 3), metres, world."""
        ...

    def feed_back(self, prepared: Any, state: Any, garments: tuple[Tensor, ...]) -> Any:
        """Replace what was predicted last by other garments, (B, N, 3) m each: after contact, or true ones.

        Returns the very state where that changes nothing.
        """
        return state

    def displaced(self, prepared: Any, state: Any, shift: Tensor) -> Any:
        """The state with all places in it displaced by (B, 3) m: coordinates follow the body's root."""
        return state

    def with_contact(self) -> "Method":
        """The method where contact follows: without the parts that only do what contact does.

        Returns the very method where there is no such thing.
        """
        return self

    def as_rig(self, body: Body, garments: tuple[Garment, ...] = ()) -> PoseRig | None:
        """The method as blend weights and blend shapes on a body, for engines; None where it is none.

        garments: of that body, the innermost first, for a method that rigs any outfit; a method of an outfit
        of its own needs none. Raises InputError if it is a rig, but for another body or other garments.
        """
        return None

    def garment_space(self, garment: Garment, body: Body) -> "GarmentSpace | None":
        """The space of shapes from which it draws a garment; None where it has none."""
        return None

    def round_trip(
        self, prepared: Any, frames: BodyFrames, garments: tuple[Tensor, ...]
    ) -> tuple[Tensor, ...] | None:
        """Simulated garments (B, N, 3) written in the method's representation and read back, the least error
        that it can have; None where it can show any garment."""
        return None


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


@dataclass(frozen=True)
class MethodEntry:
    """A method in the registry.

    config: its frozen settings. create: what makes a method of settings, untrained where it learns. presets:
    other settings by name. load: what makes a method of a checkpoint (read from a folder), None where it
    never learns.
    """

    config: Any
    create: Callable[[Any], Method]
    presets: Mapping[str, Any] = field(default_factory=dict)
    load: Callable[[Checkpoint, Path], Method] | None = None


def require_supported(method: Method, outfit: Outfit) -> None:
    """Raise InputError if a method cannot dress an outfit, with its reason."""
    if reason := method.unsupported_reason(outfit):
        raise InputError(reason)


def require_fabric_read(method: Method, fabric: str | None) -> None:
    """Raise InputError where a fabric was asked for, by name, that a method does not look at."""
    if fabric is not None and not method.reads_fabric():
        raise InputError(
            f"--fabric {fabric}: model {method.name} knows only the fabric of its training, leave it out"
        )


def for_inference(network: nn.Module, device: torch.device) -> Any:
    """A copy of a network on a device, as it predicts: without dropout and gradients, channels last."""
    copied = copy.deepcopy(network).to(device=device)
    return copied.to(memory_format=torch.channels_last).eval().requires_grad_(False)  # type: ignore[call-overload]
