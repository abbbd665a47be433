"""Several methods together, each for one garment of an outfit, the innermost first."""

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from uvcloth.bodies.frames import BodyFrames
from uvcloth.garments.garment import Outfit
from uvcloth.methods.method import Method, require_supported


@dataclass(frozen=True)
class Ensemble(Method):
    """Methods in order: the prediction of each lies beneath the garment of the next (Motion-guided, 6.5)."""

    methods: tuple[Method, ...]
    name: str = ""
    autoregressive: bool = True
    quasi_static: bool = False

    @classmethod
    def of(cls, methods: tuple[Method, ...]) -> "Ensemble":
        """Methods in the order of the garments, the innermost first."""
        name = "+".join(method.name for method in methods)
        return cls(methods, name, quasi_static=all(method.quasi_static for method in methods))

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The reason of the first method that does not support its garment, or that their numbers differ."""
        if len(self.methods) != len(outfit.garments):
            counts = f"models given: {len(self.methods)}, garments: {len(outfit.garments)}"
            return f"{counts}; expected one model for all, or one for each in order, the innermost first"
        parts = zip(self.methods, _layers(outfit), strict=True)
        return next(filter(None, (method.unsupported_reason(layer) for method, layer in parts)), "")

    def reads_fabric(self) -> bool:
        """True if one of them reads the fabric."""
        return any(method.reads_fabric() for method in self.methods)

    def with_contact(self) -> "Ensemble":
        """Each where contact follows; the very ensemble where that changes none."""
        methods = tuple(method.with_contact() for method in self.methods)
        changed = any(after is not before for after, before in zip(methods, self.methods, strict=True))
        return replace(self, methods=methods) if changed else self

    def prepare(self, outfit: Outfit, device: torch.device) -> tuple[Any, ...]:
        """Prepare each for its garment. Raises InputError for an outfit that is not supported."""
        require_supported(self, outfit)
        parts = zip(self.methods, _layers(outfit), strict=True)
        return tuple(method.prepare(layer, device) for method, layer in parts)

    def init(self, prepared: tuple[Any, ...], frames: BodyFrames) -> tuple[Any, ...]:
        """Start each."""
        return tuple(m.init(ready, frames) for m, ready in zip(self.methods, prepared, strict=True))

    def step(
        self, prepared: tuple[Any, ...], state: tuple[Any, ...], frames: BodyFrames
    ) -> tuple[tuple[Any, ...], tuple[Tensor, ...]]:
        """The next garments (B, N, 3), m."""
        following: list[Any] = []
        garments: list[Tensor] = []
        for method, ready, before in zip(self.methods, prepared, state, strict=True):
            over = replace(frames, under=garments[-1] if garments else None)
            after, (vertices,) = method.step(ready, before, over)
            following.append(after)
            garments.append(vertices)
        return tuple(following), tuple(garments)

    def feed_back(
        self, prepared: tuple[Any, ...], state: tuple[Any, ...], garments: tuple[Tensor, ...]
    ) -> tuple[Any, ...]:
        """Feed back each garment to its model; returns the same state if nothing changes."""
        parts = zip(self.methods, prepared, state, garments, strict=True)
        following = tuple(m.feed_back(ready, before, (vertices,)) for m, ready, before, vertices in parts)
        changed = any(after is not before for after, before in zip(following, state, strict=True))
        return following if changed else state

    def displaced(self, prepared: tuple[Any, ...], state: tuple[Any, ...], shift: Tensor) -> tuple[Any, ...]:
        """The state of each with its places displaced by (B, 3) m."""
        parts = zip(self.methods, prepared, state, strict=True)
        return tuple(method.displaced(ready, before, shift) for method, ready, before in parts)


def _layers(outfit: Outfit) -> tuple[Outfit, ...]:
    """Each garment by itself, over the one before it."""
    beneath = (None, *outfit.garments[:-1])
    return tuple(
        Outfit(outfit.body, (garment,), under)
        for garment, under in zip(outfit.garments, beneath, strict=True)
    )
