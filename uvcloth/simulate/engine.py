"""What a cloth engine is given and gives back; each engine is one file beside this one."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from torch import Tensor

from uvcloth.bodies import frames

GRAVITY = -frames.GRAVITY[2]
"""m/s2, downwards."""


@dataclass(frozen=True)
class Scene:
    """Cloth on a moving collider: one garment, or several that keep apart.

    rest: (N, 3) cloth at rest, also where it starts. faces: (M, 3). band: (N,) bool, held up by a soft
    attachment. heavier: (N,) how many times heavier each vertex is; the band's are, so that they can carry
    the rest. room: (N,) m that other cloth takes between a vertex and the collider.
    skinned: (F, N, 3) the skinned garment, which attachment and drag follow.
    collider: (F, C, 3) collider vertices. collider_parts: (K, 3) faces of each of its closed parts.
    touches: (parts, N) bool, which part may touch which vertex. fps: frames per second.
    """

    rest: Tensor
    faces: Tensor
    band: Tensor
    heavier: Tensor
    room: Tensor
    skinned: Tensor
    collider: Tensor
    collider_parts: tuple[Tensor, ...]
    touches: Tensor
    fps: float


class Engine(Protocol):
    """A cloth engine: what the metadata say of it, and the simulation itself."""

    def describe(self) -> dict[str, Any]:
        """Engine, exact versions and settings, as JSON values."""
        ...

    def simulate(self, scene: Scene) -> Iterator[Tensor]:
        """Yield the cloth's vertices (N, 3) at every frame of the scene, in order."""
        ...
