"""The solver, stepped by hand: cloth with or without a body, held at some vertices."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray
from torch import Tensor

from tests.simulation.physics.scenes import RIGID
from uvcloth.physics.cloth.body import Body, make_body
from uvcloth.physics.cloth.cloth import Cloth, Damping, make_cloth
from uvcloth.physics.cloth.solver import Motion, Settings, Solver, State, make_solver, start, step
from uvcloth.physics.fabric import Fabric
from uvcloth.physics.self_intersection import crossing_edges_percent
from uvcloth.player.cloth import Elastic, Pairs

VACUUM, DAMPING = Fabric(drag=0.0), Damping()
HOLD = 100.0
"""Frequency, 1/s, of the springs that hold vertices."""

INSTANT = 1e-7
"""Seconds in which nothing moves as far as float32 resolves."""


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


def elastic_forces(
    cloth: Cloth, points: Tensor, speeds: Tensor | None = None, wind: Sequence[float] = (0.0, 0.0, 0.0)
) -> NDArray[np.float32]:
    """Forces (N, 3) N of faces and hinges at points (N, 3) m that move at (N, 3) m/s."""
    forces = np.zeros(points.shape, np.float32)
    moving = np.zeros_like(forces) if speeds is None else np.ascontiguousarray(speeds, np.float32)
    elastic = Elastic(cloth.elastic_sections(), len(points))
    elastic.add_forces(points.float().numpy(), moving, forces, np.array(wind, np.float32))
    return forces


def pairs_near(
    cloth: Cloth,
    points: NDArray,
    margin: float,
    speeds: NDArray | None = None,
    ahead: float = INSTANT,
    body: Body | None = None,
) -> Pairs:
    """Pairs of cloth at points (N, 3) m that are within a margin, m, or get there in a time ahead, s.

    speeds: (N, 3) m/s.
    """
    nothing = make_body(np.zeros((0, 3)), [], np.zeros((0, len(points)), bool))
    settings = Settings(self_radius=0.0, fold=0.0, self_margin=margin, interval=ahead)
    made = make_solver(cloth, cloth.rest, body or nothing, settings)
    state = start(made, points)
    if speeds is not None:
        state = replace(state, velocities=speeds.astype(np.float32))
    still, places = np.zeros(len(points), np.float32), points.astype(np.float64)
    ends = made.body.rest, made.body.rest, places, places
    return step(made, state, Motion(INSTANT, *ends, still, still)).pairs


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
