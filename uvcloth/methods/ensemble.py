"""Several methods together, each for one garment of an outfit, the innermost first."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import BodyFrames
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.methods.capabilities import (
    Feedback,
    FinishAware,
    GarmentSpace,
    Representation,
    Swinging,
    Wrapper,
    before_finish,
    feed_back,
    garment_space,
    round_trip,
    with_dynamics,
)
from uvcloth.methods.method import Method, Traits, require_supported


@dataclass(frozen=True)
class Ensemble(Wrapper, Feedback, FinishAware, Swinging, Representation):
    """Methods in order: the prediction of each lies beneath the garment of the next (Motion-guided, 6.5)."""

    methods: tuple[Method, ...]
    name: str = ""

    @classmethod
    def of(cls, methods: tuple[Method, ...]) -> "Ensemble":
        """Methods in the order of the garments, the innermost first."""
        return cls(methods, "+".join(method.name for method in methods))

    @property
    def parts(self) -> tuple[Method, ...]:
        """The methods."""
        return self.methods

    @property
    def traits(self) -> Traits:
        """Quasi-static if all are, reading the fabric if one does; one frame at a time in any case."""
        each = [method.traits for method in self.methods]
        return Traits(
            autoregressive=True,
            quasi_static=all(traits.quasi_static for traits in each),
            reads_fabric=any(traits.reads_fabric for traits in each),
        )

    def unsupported_reason(self, outfit: Outfit) -> str:
        """The reason of the first method that does not support its garment, or that their numbers differ."""
        if len(self.methods) != len(outfit.garments):
            counts = f"models given: {len(self.methods)}, garments: {len(outfit.garments)}"
            return f"{counts}; expected one model for all, or one for each in order, the innermost first"
        parts = zip(self.methods, _layers(outfit), strict=True)
        return next(filter(None, (method.unsupported_reason(layer) for method, layer in parts)), "")

    def before_finish(self) -> "Ensemble":
        """Each where a finish follows; the very ensemble where that changes none."""
        methods = tuple(map(before_finish, self.methods))
        changed = any(after is not before for after, before in zip(methods, self.methods, strict=True))
        return replace(self, methods=methods) if changed else self

    def with_dynamics(self, factor: float) -> "Ensemble":
        """Each with its dynamics scaled. Raises InputError for the first that cannot."""
        return replace(self, methods=tuple(with_dynamics(method, factor) for method in self.methods))

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
        following = tuple(feed_back(m, ready, before, (vertices,)) for m, ready, before, vertices in parts)
        changed = any(after is not before for after, before in zip(following, state, strict=True))
        return following if changed else state

    def displaced(self, prepared: tuple[Any, ...], state: tuple[Any, ...], shift: Tensor) -> tuple[Any, ...]:
        """The state of each with its places displaced by (B, 3) m."""
        parts = zip(self.methods, prepared, state, strict=True)
        return tuple(method.displaced(ready, before, shift) for method, ready, before in parts)

    def round_trip(
        self, prepared: tuple[Any, ...], frames: BodyFrames, garments: tuple[Tensor, ...]
    ) -> tuple[Tensor, ...] | None:
        """Each garment (B, N, 3) m in the representation of its model; None if one has none."""
        read: list[Tensor] = []
        for method, ready, vertices, beneath in zip(
            self.methods, prepared, garments, (None, *garments[:-1]), strict=True
        ):
            shown = round_trip(method, ready, replace(frames, under=beneath), (vertices,))
            if shown is None:
                return None
            read.extend(shown)
        return tuple(read)

    def garment_space(self, garment: Garment, body: Body) -> GarmentSpace | None:
        """The space of the first model that has one for this garment."""
        spaces = (garment_space(method, garment, body) for method in self.methods)
        return next((space for space in spaces if space), None)


def in_order(methods: Sequence[Method]) -> Method:
    """One method for all garments as it is, or an ensemble of several, the innermost first."""
    return methods[0] if len(methods) == 1 else Ensemble.of(tuple(methods))


def _layers(outfit: Outfit) -> tuple[Outfit, ...]:
    """Each garment by itself, over the one before it."""
    beneath = (None, *outfit.garments[:-1])
    return tuple(
        Outfit(outfit.body, (garment,), under)
        for garment, under in zip(outfit.garments, beneath, strict=True)
    )
