"""Recorded sequences as a method, so that the finishes of methods also apply to other programs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from uvcloth.bodies.frames import BodyFrames
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.methods.method import Method, Traits

SAME = 1e-3
"""Largest difference of transforms, m, of one motion around two origins."""


@dataclass(frozen=True)
class Recorded(Method):
    """A method that plays recorded garments, from the first frame of their motion on.

    start: (J, 3, 4) joint transforms of the first frame, relative to the root. garments: (T, N, 3) m of
    each, relative to the root of each frame, because rollouts move around it.
    """

    name: str
    start: Tensor
    garments: tuple[Tensor, ...]
    # As a baseline, it is also judged where its cloth is torn.
    traits = Traits(autoregressive=True, is_baseline=True)

    @classmethod
    def of(cls, name: str, motion: Tensor, garments: Sequence[Tensor]) -> Self:
        """A recording of garments (T, N, 3) m, world, over joint transforms (T, J, 3, 4)."""
        roots = motion[:, 0]
        local = [_from_root(roots[: len(garment)], garment) for garment in garments]
        return cls(name, _from_root(motion[:1, 0], motion[:1, :, :, 3])[0], tuple(local))

    def prepare(self, outfit: Outfit, device: torch.device) -> tuple[()]:
        """Nothing depends on the outfit."""
        return ()

    def init(self, prepared: tuple[()], frames: BodyFrames) -> int:
        """The first frame. Raises InputError if the motion does not begin there."""
        now = frames.transforms[:, -1]
        if not torch.allclose(_from_root(now[:, 0], now[..., 3])[0], self.start, rtol=0.0, atol=SAME):
            raise InputError(f"{self.name}: the motion jumps, and a recording cannot start again there")
        return 0

    def step(self, prepared: tuple[()], state: int, frames: BodyFrames) -> tuple[int, tuple[Tensor, ...]]:
        """The recorded garments (B, N, 3) m of the next frame."""
        roots = frames.transforms[:, -1, 0]
        rotations, places = roots[..., :3], roots[:, None, :, 3]
        return state + 1, tuple(
            garment[state] @ rotations.transpose(1, 2) + places.to(garment) for garment in self.garments
        )


def _from_root(roots: Tensor, points: Tensor) -> Tensor:
    """Points (T, N, 3) m relative to roots (T, 3, 4)."""
    return (points - roots[:, None, :, 3]) @ roots[..., :3]
