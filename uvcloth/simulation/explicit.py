"""The project's own cloth solver as an engine: explicit integration in many small substeps."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from importlib.metadata import version
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uvcloth.bodies.collider import compact
from uvcloth.physics.cloth.body import Body, make_body
from uvcloth.physics.cloth.cloth import Damping, make_cloth
from uvcloth.physics.cloth.solver import (
    HOLD,
    HOLD_DAMPING,
    Motion,
    Settings,
    Solver,
    State,
    make_solver,
    moving_frame,
    start,
    step,
)
from uvcloth.physics.fabric import Fabric
from uvcloth.player.cloth import Pairs, nothing_searched
from uvcloth.simulation.engine import Frame, Scene

# Versions are looked up in files, and an engine is described once for every sequence of a folder.
_version = cache(version)


@dataclass(frozen=True)
class Explicit:
    """The explicit solver (`uvcloth.physics.cloth`).

    damping, moved_mass: of the cloth, as `make_cloth` says. settings: of the solver. more_substeps: factor on
    the number of substeps. hold: 1/s, the frequency of the soft attachment of the band.
    """

    name: str = "uvcloth.explicit"
    fabric: Fabric = field(default_factory=Fabric)
    damping: Damping = field(default_factory=Damping)
    moved_mass: float = 0.01
    settings: Settings = field(default_factory=Settings)
    more_substeps: float = 1.0
    hold: float = HOLD

    def describe(self) -> dict[str, Any]:
        """Describe engine, versions and settings, as `Engine` says."""
        return {
            "engine": self.name,
            "versions": {"uvcloth": _version("uvcloth")},
            "settings": asdict(self),
        }

    def with_fabric(self, fabric: Fabric) -> Self:
        """Make the same engine for cloth of another fabric."""
        return replace(self, fabric=fabric)

    def with_more_substeps(self, share: float) -> Self:
        """Make the same engine with 1 + share times as many substeps."""
        return replace(self, more_substeps=(1.0 + share) * self.more_substeps)

    def simulate(self, scene: Scene, after: Frame | None = None) -> Iterator[Frame]:
        """Yield the frames as `Engine` says.

        Raises InputError for cloth that the solver cannot step, ValueError for `after` without a memory.
        """
        used, parts = compact(scene.collider_parts)
        body, targets = scene.collider[:, used].numpy(), scene.skinned.numpy()
        solver = self._solver(scene, body[0], parts)
        pull = np.where(scene.band.numpy(), self.hold, 0.0).astype(np.float32)
        damping = np.full(len(pull), HOLD_DAMPING, np.float32)
        if after is None:
            state = start(solver, scene.rest.numpy())
            after = Frame(0, scene.rest, _memory(state))
            yield after
        elif after.memory is None:
            raise ValueError("a frame without the engine's state cannot be continued")
        else:
            before = targets[max(after.index - 1, 0)]
            state = _recall(after.memory, solver.body, before, targets[after.index], scene.fps)
        for frame in range(after.index + 1, len(targets)):
            ends = body[frame - 1], body[frame], targets[frame - 1], targets[frame]
            state = step(solver, state, Motion(1.0 / scene.fps, *ends, pull, damping))
            yield Frame(frame, torch.from_numpy(state.vertices()).float(), _memory(state))

    def _solver(self, scene: Scene, body_vertices: NDArray, parts: list[NDArray]) -> Solver:
        cloth = make_cloth(
            scene.rest.numpy(),
            scene.faces.numpy(),
            self.fabric,
            mass_factor=scene.mass_factor.numpy(),
            thickness=scene.inner_thickness.numpy(),
            damping=self.damping,
            moved_mass=self.moved_mass,
        )
        settings = replace(self.settings, safety=self.settings.safety / self.more_substeps)
        return make_solver(
            cloth, scene.rest.numpy(), make_body(body_vertices, parts, scene.touches.numpy()), settings
        )


def _memory(state: State) -> Tensor:
    """All that a state remembers but its frame of reference: (K,), float32 holds indices exactly."""
    pairs = state.pairs
    arrays = (state.positions, state.velocities, pairs.points, pairs.sides, pairs.edges, pairs.directions)
    sizes = [len(pairs.points), len(pairs.edges)]
    return torch.from_numpy(np.concatenate([sizes, *(array.ravel() for array in arrays)]).astype(np.float32))


def _recall(memory: Tensor, body: Body, before: NDArray, after: NDArray, fps: float) -> State:
    """State of a memory. before, after: (N, 3) m, the targets of the frame before and of its own."""
    numbers, count = memory.numpy(), len(after)
    points, edges = (int(size) for size in numbers[:2])
    sizes = (3 * count, 3 * count, 2 * points, points, 2 * edges, 3 * edges)
    parts = np.split(numbers[2:], np.cumsum(sizes)[:-1])
    pairs = Pairs(
        parts[2].reshape(-1, 2).astype(np.int32),
        parts[3].copy(),
        parts[4].reshape(-1, 2).astype(np.int32),
        parts[5].reshape(-1, 3).copy(),
    )
    _, origin, drift = moving_frame(before, after, 1.0 / fps)
    positions, velocities = (part.reshape(-1, 3).copy() for part in parts[:2])
    return State(positions, velocities, origin, drift, pairs, nothing_searched(*body.touches.shape))
