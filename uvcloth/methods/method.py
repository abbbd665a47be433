"""The protocol of a garment method: prepare an outfit once, then step frame after frame."""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeVar

import torch
from torch import Tensor, nn

from uvcloth.bodies.frames import BodyFrames
from uvcloth.checkpoint import Checkpoint
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit

Capability = TypeVar("Capability")


@dataclass(frozen=True)
class Traits:
    """Properties of a method that rollout, clearing and evaluation depend on.

    autoregressive: the state holds earlier predictions; then the B frames of a step are those of B rollouts
    side by side, otherwise any B frames. quasi_static: a frame depends on its pose alone, however fast the
    body moves. keeps_off_body: its garments are off the body and off each other as predicted, so that nothing
    is cleared. reads_fabric: garments of other fabrics move differently. is_baseline: other methods are
    measured against it.
    """

    autoregressive: bool = False
    quasi_static: bool = False
    keeps_off_body: bool = False
    reads_fabric: bool = False
    is_baseline: bool = False


class Method(Protocol):
    """The members of every garment method; a class that derives from it inherits the defaults.

    A method holds its settings and weights and never changes. What it computes once for an outfit is
    `Prepared`, shared by all rollouts; what it keeps from frame to frame is `State`, of its own type, passed
    along. What only some methods can do is in `capabilities.py`.
    """

    name: str
    """The name in tables and messages."""

    @property
    def traits(self) -> Traits:
        """Properties that rollout, clearing and evaluation depend on."""
        return Traits()

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The reason that it cannot dress an outfit, in words that name garment and model; "" if it can."""
        return ""

    def prepare(self, outfit: Outfit, device: torch.device) -> Any:
        """Compute what depends on the outfit alone (ray casts, layouts, weights on the device): Prepared."""
        ...

    def init(self, prepared: Any, frames: BodyFrames) -> Any:
        """Start from the first frames of B rollouts: State."""
        return ()

    def step(self, prepared: Any, state: Any, frames: BodyFrames) -> tuple[Any, tuple[Tensor, ...]]:
        """Predict B frames: the next state and, per garment, vertices (B, N, 3), metres, world."""
        ...

    def displaced(self, prepared: Any, state: Any, shift: Tensor) -> Any:
        """The state with all positions in it displaced by (B, 3) m: coordinates follow the body's root."""
        return state

    def capability(self, kind: type[Capability]) -> Capability | None:
        """This method as one of the classes of `capabilities.py`; None if it is not of that kind."""
        return self if isinstance(self, kind) else None


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
    if fabric is not None and not method.traits.reads_fabric:
        raise InputError(
            f"--fabric {fabric}: model {method.name} knows only the fabric of its training, leave it out"
        )


def for_inference(network: nn.Module, device: torch.device) -> Any:
    """A copy of a network on a device, as it predicts: without dropout and gradients, channels last."""
    copied = copy.deepcopy(network).to(device=device)
    return copied.to(memory_format=torch.channels_last).eval().requires_grad_(False)  # type: ignore[call-overload]
