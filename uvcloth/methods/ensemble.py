"""Several methods together, each dressing one garment of an outfit, the innermost first."""

from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor

from rasterize.errors import InputError
from uvcloth.bodies.frames import BodyFrames
from uvcloth.garments.garment import Outfit
from uvcloth.methods.method import Method


@dataclass(frozen=True)
class Ensemble:
    """A Method: what one predicts, the next one's garment is worn over (Motion-guided, section 6.5)."""

    methods: tuple[Method, ...]
    autoregressive: bool = True

    @property
    def name(self) -> str:
        return "+".join(method.name for method in self.methods)

    @property
    def quasi_static(self) -> bool:
        return all(method.quasi_static for method in self.methods)

    def unsupported_reason(self, outfit: Outfit) -> str:
        """It dresses as many garments as there are methods, each of which dresses its own."""
        if len(self.methods) != len(outfit.garments):
            counts = f"models given: {len(self.methods)}, garments: {len(outfit.garments)}"
            return f"{counts}; expected one model for all, or one for each in order, the innermost first"
        parts = zip(self.methods, _layers(outfit), strict=True)
        return next(filter(None, (method.unsupported_reason(layer) for method, layer in parts)), "")

    def start(self, outfit: Outfit, frames: BodyFrames) -> tuple[Any, ...]:
        """Start each on its garment. Raises InputError for an outfit that it has an unsupported_reason to."""
        if unsupported_reason := self.unsupported_reason(outfit):
            raise InputError(unsupported_reason)
        parts = zip(self.methods, _layers(outfit), strict=True)
        return tuple(method.start(layer, frames) for method, layer in parts)

    def step(self, state: tuple[Any, ...], frames: BodyFrames) -> tuple[tuple[Any, ...], tuple[Tensor, ...]]:
        """The next garments (1, N, 3), m."""
        following: list[Any] = []
        garments: list[Tensor] = []
        for method, before in zip(self.methods, state, strict=True):
            over = replace(frames, under=garments[-1] if garments else None)
            after, (vertices,) = method.step(before, over)
            following.append(after)
            garments.append(vertices)
        return tuple(following), tuple(garments)

    def observe(self, state: tuple[Any, ...], garments: tuple[Tensor, ...]) -> tuple[Any, ...]:
        """Tell those that remember what contact left."""
        return tuple(
            method.observe(before, (vertices,)) if method.autoregressive else before
            for method, before, vertices in zip(self.methods, state, garments, strict=True)
        )


def _layers(outfit: Outfit) -> tuple[Outfit, ...]:
    """Each garment by itself, over the one before it."""
    beneath = (None, *outfit.garments[:-1])
    return tuple(
        Outfit(outfit.body, (garment,), under)
        for garment, under in zip(outfit.garments, beneath, strict=True)
    )
