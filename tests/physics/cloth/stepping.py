"""The solver, stepped by hand: cloth with or without a body, held at some vertices."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray
from torch import Tensor

from tests.simulate.physics.scenes import RIGID
from uvcloth.physics.cloth.cloth import Damping, make_cloth
from uvcloth.physics.cloth.moving_body import make_body
from uvcloth.physics.cloth.solver import Motion, Settings, Solver, State, make_solver, step
from uvcloth.physics.fabric import Fabric
from uvcloth.physics.self_intersection import crossing_edges_percent

VACUUM, DAMPING = Fabric(drag=0.0), Damping()
HOLD = 100.0
"""Frequency, 1/s, of the springs that hold vertices."""


def solver(
    rest: Tensor,
    faces: Tensor,
    fabric: Fabric | Sequence[Fabric] = VACUUM,
    held: Tensor | None = None,
    things: Sequence[trimesh.Trimesh] = (),
    damping: Damping = DAMPING,
    moved_mass: float = 0.01,
    fabric_of: NDArray[np.integer] | None = None,
    **settings: Any,
) -> Solver:
    """Cloth (N, 3), held at some vertices (N,) bool, among things."""
    factor = None if held is None else torch.where(held, RIGID, 1.0).numpy()
    cloth = make_cloth(
        rest.numpy(),
        faces.numpy(),
        fabric,
        mass_factor=factor,
        fabric_of=fabric_of,
        damping=damping,
        moved_mass=moved_mass,
    )
    starts = np.cumsum([0] + [len(thing.vertices) for thing in things])
    parts = [thing.faces + first for thing, first in zip(things, starts, strict=False)]
    body = make_body(surface(things), parts, np.ones((len(things), len(rest)), bool))
    return make_solver(cloth, rest.numpy(), body, Settings(**settings))


def surface(things: Sequence[trimesh.Trimesh]) -> NDArray[np.float64]:
    """Vertices (V, 3) m of all things."""
    return np.concatenate([np.zeros((0, 3)), *(thing.vertices for thing in things)])


def frames(
    made: Solver,
    state: State,
    targets: NDArray,
    bodies: NDArray,
    fps: float,
    held: Tensor | None = None,
    acceleration: NDArray[np.float32] | None = None,
) -> Iterator[State]:
    """States after each frame. targets: (F + 1, N, 3) m, bodies: (F + 1, V, 3) m."""
    pull = np.zeros(targets.shape[1], np.float32)
    if held is not None:
        pull[held.numpy()] = HOLD
    damping = np.ones_like(pull)
    for frame in range(1, len(targets)):
        ends = bodies[frame - 1], bodies[frame], targets[frame - 1], targets[frame]
        state = step(made, state, Motion(1.0 / fps, *ends, pull, damping, acceleration))
        yield state


def still_frames(
    made: Solver,
    state: State,
    rest: Tensor,
    seconds: float,
    fps: float = 30.0,
    held: Tensor | None = None,
    things: Sequence[trimesh.Trimesh] = (),
    acceleration: NDArray[np.float32] | None = None,
) -> list[State]:
    """States after each frame where nothing but the cloth moves."""
    count = round(seconds * fps) + 1
    targets, bodies = (np.repeat(points[None], count, 0) for points in (rest.numpy(), surface(things)))
    return list(frames(made, state, targets, bodies, fps, held, acceleration))


def crossing(states: Sequence[State], faces: Tensor) -> Tensor:
    """Percent of the edges that cross a face, in each state."""
    return crossing_edges_percent(
        torch.stack([torch.from_numpy(s.vertices()).float() for s in states]), faces
    )
