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
    remembers: bool = True

    @property
    def name(self) -> str:
        return "+".join(method.name for method in self.methods)

    def start(self, outfit: Outfit, frames: BodyFrames) -> tuple[Any, ...]:
        """Start each on its garment. Raises InputError unless there are as many methods as garments."""
        if len(self.methods) != len(outfit.garments):
            raise InputError(
                f"{len(self.methods)} models for {len(outfit.garments)} garments: expected one for all, "
                "or one for each in order, the innermost first"
            )
        beneath = (None, *outfit.garments[:-1])
        return tuple(
            method.start(Outfit(outfit.body, (garment,), under), frames)
            for method, garment, under in zip(self.methods, outfit.garments, beneath, strict=True)
        )

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
            method.observe(before, (vertices,)) if method.remembers else before
            for method, before, vertices in zip(self.methods, state, garments, strict=True)
        )
