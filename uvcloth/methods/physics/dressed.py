"""Cloth that characters wear, in the runtime: dressed, moved on, remembered and shown."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.methods.physics.outfit import CagedOutfit
from uvcloth.player.outfit import Cloth


@dataclass(frozen=True)
class ClothMemory:
    """Cloth of one rollout, in the world: `memory` is all that it remembers, whatever moved `cloth` since."""

    cloth: Cloth
    memory: NDArray[np.uint8]

    @classmethod
    def after(cls, cloth: Cloth) -> Self:
        """Cloth as it is now."""
        return cls(cloth, cloth.save())

    def recalled(self) -> Cloth:
        """The cloth as it was then."""
        self.cloth.restore(self.memory)
        return self.cloth


def dressed(prepared: CagedOutfit, joints: Tensor) -> Cloth:
    """Cloth at rest on a body that went from its rest pose to that of joints (J, 3, 4).

    Raises InputError if it finds no rest.
    """
    cloth = Cloth(prepared.baked)
    settle(cloth, joints)
    return cloth


def settle(cloth: Cloth, joints: Tensor) -> None:
    """Let cloth come to rest on joints (J, 3, 4). Raises InputError as the runtime says it."""
    with _as_input_errors():
        cloth.start(joints.double().numpy())


def move_on(cloth: Cloth, joints: Tensor, fps: float) -> None:
    """Move cloth on to a frame. Raises InputError as the runtime says it."""
    with _as_input_errors():
        cloth.step(joints.double().numpy(), 1.0 / fps)


def shown(cloth: Cloth, origin: Tensor) -> tuple[Tensor, ...]:
    """Garments (N, 3) m around an origin, (3,) float64 m."""
    garments = (torch.from_numpy(cloth.vertices(each)) for each in range(len(cloth.outfit.garments)))
    return tuple((vertices - origin).float() for vertices in garments)


@contextmanager
def _as_input_errors() -> Iterator[None]:
    """Raise what the runtime refuses as InputError."""
    try:
        yield
    except ValueError as error:
        raise InputError(str(error)) from error
