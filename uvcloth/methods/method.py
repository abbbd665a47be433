"""The protocol that every garment method fits: start on an outfit, then step frame after frame."""

from typing import Any, Protocol

from torch import Tensor

from uvcloth.bodies.frames import BodyFrames
from uvcloth.garments.garment import Outfit


class Method(Protocol):
    """What rollout and evaluation see of a method.

    remembers: whether the state carries the garment from frame to frame. A method that remembers nothing may
    be given many frames at once as a batch; one that remembers gets one frame at a time (B = 1).

    static: whether a frame depends on its own pose alone, however fast the body came there.
    """

    @property
    def name(self) -> str: ...

    @property
    def remembers(self) -> bool: ...

    @property
    def static(self) -> bool: ...

    def objection(self, outfit: Outfit) -> str:
        """Why it cannot dress an outfit: a sentence that names garment and model; "" where it can."""
        ...

    def start(self, outfit: Outfit, frames: BodyFrames) -> Any:
        """Prepare an outfit (projections, carriers) at the first frame; returns the state.

        Raises InputError for an outfit that it has an objection to.
        """
        ...

    def step(self, state: Any, frames: BodyFrames) -> tuple[Any, tuple[Tensor, ...]]:
        """Predict frames in order: the next state and, per garment, vertices (B, N, 3), metres, world."""
        ...

    def observe(self, state: Any, garments: tuple[Tensor, ...]) -> Any:
        """What the state becomes when the last garments were (N, 3) each and not as predicted.

        Rollout calls it after contact for a method that remembers; one-step errors feed it the truth.
        """
        ...
