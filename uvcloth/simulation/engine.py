"""Protocol of the cloth engines, and their scene; each engine is one file beside this one."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

from torch import Tensor

from uvcloth.physics.fabric import Fabric


@dataclass(frozen=True)
class Scene:
    """Cloth on a moving collider: one garment, or several that keep apart.

    rest: (N, 3) cloth at rest, also where it starts. faces: (M, 3). band: (N,) bool, held up by a soft
    attachment. mass_factor: (N,) on the mass of each vertex; the band's are heavier, so that they can carry
    the rest. inner_thickness: (N,) m of other cloth between a vertex and the collider.
    skinned: (F, N, 3) the skinned garment, which attachment and drag follow.
    collider: (F, C, 3) collider vertices. collider_parts: faces (M, 3) of each of its K closed parts.
    touches: (K, N) bool, the parts that may touch each vertex. fps: frames per second.
    """

    rest: Tensor
    faces: Tensor
    band: Tensor
    mass_factor: Tensor
    inner_thickness: Tensor
    skinned: Tensor
    collider: Tensor
    collider_parts: tuple[Tensor, ...]
    touches: Tensor
    fps: float


@dataclass(frozen=True)
class Frame:
    """Cloth at one frame of a scene.

    index: of the frame. vertices: (N, 3) m. memory: (K,) all numbers that the engine remembers there, from
    which it makes the frames after it again, the same to the byte; None if it cannot.
    """

    index: int
    vertices: Tensor
    memory: Tensor | None = None


class Engine(Protocol):
    """A cloth engine: its description for the metadata, and the simulation."""

    def describe(self) -> dict[str, Any]:
        """Engine, exact versions and settings, as JSON values."""
        ...

    def with_fabric(self, fabric: Fabric) -> Self:
        """Make the same engine for cloth of another fabric."""
        ...

    def simulate(self, scene: Scene, after: Frame | None = None) -> Iterator[Frame]:
        """Yield every frame of the scene, in order.

        after: a frame with a memory, made by an equal engine from an equal scene; only later frames are
        yielded.
        """
        ...


@runtime_checkable
class SubstepEngine(Engine, Protocol):
    """An engine whose number of substeps can be changed, for ensembles of simulations."""

    def with_more_substeps(self, share: float) -> Self:
        """Make the same engine with 1 + share times as many substeps."""
        ...
