"""The protocol that every garment method fits: start on an outfit, then step frame after frame."""

from typing import Any, Protocol

from torch import Tensor

from uvcloth.bodies.frames import BodyFrames
from uvcloth.garments.garment import Outfit


class Method(Protocol):
    """What rollout and evaluation see of a method.

    autoregressive: whether the state holds what was predicted before. A method that is not may
    be given many frames at once as a batch; one that is gets one frame at a time (B = 1).

    quasi_static: whether a frame depends on its own pose alone, however fast the body came there.
    """

    @property
    def name(self) -> str: ...

    @property
    def autoregressive(self) -> bool: ...

    @property
    def quasi_static(self) -> bool: ...

    def unsupported_reason(self, outfit: Outfit) -> str:
        """Why it cannot dress an outfit: a sentence that names garment and model; "" where it can."""
        ...

    def start(self, outfit: Outfit, frames: BodyFrames) -> Any:
        """Prepare an outfit (projections, blend weights) at the first frame; returns the state.

        Raises InputError for an outfit that it has an unsupported_reason to.
        """
        ...

    def step(self, state: Any, frames: BodyFrames) -> tuple[Any, tuple[Tensor, ...]]:
        """Predict frames in order: the next state and, per garment, vertices (B, N, 3), metres, world."""
        ...

    def observe(self, state: Any, garments: tuple[Tensor, ...]) -> Any:
        """What the state becomes when the last garments were (N, 3) each and not as predicted.

        Rollout calls it after contact for an autoregressive method; one-step errors feed it the truth.
        """
        ...
