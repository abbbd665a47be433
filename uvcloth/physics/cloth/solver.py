"""The cloth solver: symplectic Euler in many small substeps, with contact, stepped frame by frame."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from uvcloth.errors import InputError
from uvcloth.physics.cloth.body import Body
from uvcloth.physics.cloth.cloth import SPACING, Cloth
from uvcloth.physics.cloth.stability import largest_step
from uvcloth.player.cloth import ClothSolver, ContactCache, Pairs, no_pairs, nothing_searched

Floats = NDArray[np.float32]

HOLD, HOLD_DAMPING = 100.0, 0.7
"""Frequency, 1/s, and damping ratio of the springs that hold the band of a garment."""

MOST_SUBSTEPS_PER_SECOND = 60_000
"""Substeps above which cloth is refused: its faces are too small, or it is too stiff, for its mass."""


@dataclass(frozen=True)
class Settings:
    """Settings of the solver, in SI units.

    safety: share of the longest stable step that is taken. substeps: per second at least. radius: m, kept
    between cloth and body. self_radius: m, kept between pieces of cloth. fold: share of the length of a short
    edge that a piece keeps from itself, at least self_radius, and no more than at rest. self_margin: m more
    within which cloth is watched, plus its motion at the relative speed until the next search. self_contact:
    False leaves it out. reach: m, how near the body, and how deep in it, cloth is looked for. renewal:
    frames from one search of all faces of the body for a vertex to the next. interval: s between two searches
    for the closest faces of the body and for cloth near cloth.
    """

    safety: float = 0.6
    substeps: int = 0
    radius: float = 0.004
    self_radius: float = 0.003
    fold: float = 0.35
    self_margin: float = 0.003
    self_contact: bool = True
    reach: float = 0.03
    renewal: int = 1
    interval: float = 1.0 / 120.0


@dataclass(frozen=True)
class Solver:
    """Cloth, the body that it collides with, and the longest stable step, s, of the cloth at rest."""

    cloth: Cloth
    body: Body
    settings: Settings
    stable_step: float

    @property
    def fold_radius(self) -> float:
        """Metres that a piece of the cloth keeps from itself: sharper folds than its edges can have would run
        through themselves.
        """
        return self.settings.fold * self.cloth.sheet.spacing / SPACING

    @cached_property
    def runtime(self) -> ClothSolver:
        """The same in the runtime, read before its first step: a baked outfit has a reader of its own."""
        return ClothSolver.of({**self.cloth.sections(), **self.body.sections()})


@dataclass(frozen=True)
class State:
    """All that the cloth remembers from one frame to the next.

    positions: (N, 3) m, velocities: (N, 3) m/s, relative to a frame of reference at `origin`, (3,) m, that
    moves at `drift`, (3,) m/s. pairs: of cloth near cloth, and their sides. substeps: of the last frame.
    near: search results for the body. frame: number of earlier frames.
    """

    positions: Floats
    velocities: Floats
    origin: NDArray[np.float64]
    drift: NDArray[np.float64]
    pairs: Pairs
    near: ContactCache
    substeps: int = 0
    frame: int = 0

    def vertices(self) -> NDArray[np.float64]:
        """Positions (N, 3) m in the world."""
        return self.positions + self.origin


@dataclass(frozen=True)
class Motion:
    """Motion of all that moves the cloth in a frame, in the world.

    seconds: of the frame. body_start, body_end: (V, 3) m before and after it. target_start, target_end:
    (N, 3) m that vertices are pulled to, with the frequency `pull`, (N,) 1/s, and the damping ratio
    `damping`, (N,); frequency 0 is not pulled. acceleration: (N, 3) m/s2 from outside, or None.
    """

    seconds: float
    body_start: NDArray
    body_end: NDArray
    target_start: NDArray
    target_end: NDArray
    pull: Floats
    damping: Floats
    acceleration: Floats | None = None


def make_solver(cloth: Cloth, rest: NDArray, body: Body, settings: Settings, name: str = "cloth") -> Solver:
    """Make a solver for cloth at rest, (N, 3) m.

    Raises InputError for cloth that needs steps shorter than those of MOST_SUBSTEPS_PER_SECOND.
    """
    step = largest_step(cloth, np.asarray(rest, np.float32))
    if not step * settings.safety * MOST_SUBSTEPS_PER_SECOND >= 1.0:
        raise InputError(
            f"{name}: needs {math.ceil(1.0 / max(1e-9, step * settings.safety))} substeps a second, "
            f"the limit is {MOST_SUBSTEPS_PER_SECOND}: one of its faces is too narrow, or its fabric is too "
            "stiff for its weight"
        )
    return Solver(cloth, body, settings, step)


def start(solver: Solver, vertices: NDArray) -> State:
    """Start at rest at (N, 3) m."""
    origin = np.asarray(vertices, np.float64).mean(0)
    positions = (vertices - origin).astype(np.float32)
    still, near = np.zeros_like(positions), nothing_searched(*solver.body.touches.shape)
    return State(positions, still, origin, np.zeros(3), no_pairs(), near)


def step(solver: Solver, state: State, motion: Motion) -> State:
    """Simulate one frame.

    The frame of reference moves evenly with the mean of the targets, which keeps numbers small where a body
    walks far. If cloth flies apart, the positions of the returned state are not finite: the caller has to
    check them. Raises InputError for a body that is too fast, or whose vertices are not finite.
    """
    origin, end, drift = moving_frame(motion.target_start, motion.target_end, motion.seconds)
    began = (state.positions + (state.origin - origin)).astype(np.float32)
    speeds = (state.velocities + (state.drift - drift)).astype(np.float32)
    arrays = {
        "body_start": _around(motion.body_start, origin),
        "body_end": _around(motion.body_end, end),
        "target_start": _around(motion.target_start, origin),
        "target_end": _around(motion.target_end, end),
        "pull": motion.pull,
        "damping": motion.damping,
        "acceleration": motion.acceleration,
    }
    settings = solver.settings
    numbers = {
        "seconds": motion.seconds,
        "radius": settings.radius,
        "self_radius": settings.self_radius,
        "fold_radius": solver.fold_radius,
        "self_margin": settings.self_margin,
        "reach": settings.reach,
        "needed": max(settings.substeps, 1.0 / (settings.safety * solver.stable_step)),
        "interval": settings.interval,
        "hinge_interval": 1,
        "frame": state.frame,
        "renewal": settings.renewal,
        "self_contact": settings.self_contact,
    }
    try:
        after = solver.runtime.step(arrays, numbers, drift, began, speeds, state.pairs, state.near)
    except ValueError as error:
        raise InputError(str(error)) from error
    if after is None:
        return replace(state, positions=np.full_like(began, np.nan), origin=end, drift=drift)
    positions, velocities, pairs, near, substeps = after
    return State(positions, velocities, end, drift, pairs, near, substeps, state.frame + 1)


def _around(points: NDArray, origin: NDArray[np.float64]) -> Floats:
    return (points - origin).astype(np.float32)


def moving_frame(
    start: NDArray, end: NDArray, seconds: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Frame of reference during a frame: its position, m, before and after, and velocity, m/s, (3,) each.

    start, end: (N, 3) m, the targets before and after the frame of `seconds`.
    """
    origin, destination = (np.asarray(points, np.float64).mean(0) for points in (start, end))
    return origin, destination, (destination - origin) / seconds
