"""The cloth solver: symplectic Euler in many small substeps, with contact, stepped from outside frame by frame."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rasterize.errors import InputError
from uvcloth.physics.cloth.body_contact import Body, find_contacts, resolve_contacts
from uvcloth.physics.cloth.cloth import Cloth
from uvcloth.physics.cloth.compiled import compiled
from uvcloth.physics.cloth.forces import add_elastic_forces
from uvcloth.physics.cloth.self_contact import Pairs, find_pairs, no_pairs, resolve_pairs
from uvcloth.physics.cloth.stability import largest_step, stiffening
from uvcloth.physics.cloth.vectors import ONE, TWO

Floats = NDArray[np.float32]

GRAVITY = np.float32(9.81)
"""Acceleration of gravity, m/s2, downwards."""

MOST_SUBSTEPS_PER_SECOND = 60_000
"""Substeps above which cloth is refused: its faces are too small, or it is too stiff, for its mass."""

FASTEST = 200.0
"""Speed, m/s, relative to the body, that no cloth has: a frame in which a vertex is faster is made again."""

RETRIES = 2
"""Times that a frame is made again, each with twice the substeps."""


@dataclass(frozen=True)
class Settings:
    """Settings of the solver, in SI units.

    safety: share of the longest stable step that is taken. substeps: per second at least. radius: m, kept
    between cloth and body. self_radius: m, kept between cloth and cloth; self_margin: m more within which cloth
    is watched, and what it moves at its relative speed until the next search. self_contact: False leaves it out.
    reach: m, how near the body, and how deep in it, cloth is looked for. interval: s between two searches for
    the closest faces of the body and for cloth near cloth.
    """

    safety: float = 0.6
    substeps: int = 0
    radius: float = 0.004
    self_radius: float = 0.003
    self_margin: float = 0.003
    self_contact: bool = True
    reach: float = 0.03
    interval: float = 1.0 / 120.0


@dataclass(frozen=True)
class Solver:
    """Cloth, the body that it meets, and the longest stable step, s, of the cloth at rest."""

    cloth: Cloth
    body: Body
    settings: Settings
    stable_step: float


@dataclass(frozen=True)
class State:
    """All that the cloth remembers from one frame to the next.

    positions: (N, 3) m, velocities: (N, 3) m/s, relative to a frame of reference at `origin`, (3,) m, that moves
    at `drift`, (3,) m/s. pairs: of cloth near cloth, and their sides. substeps: that the last frame took.
    """

    positions: Floats
    velocities: Floats
    origin: NDArray[np.float64]
    drift: NDArray[np.float64]
    pairs: Pairs
    substeps: int = 0

    def vertices(self) -> NDArray[np.float64]:
        """Positions (N, 3) m in the world."""
        return self.positions + self.origin


@dataclass(frozen=True)
class Motion:
    """What moves the cloth in a frame, in the world.

    seconds: of the frame. body_start, body_end: (V, 3) m before and after it. target_start, target_end: (N, 3) m
    that vertices are pulled to, with the frequency `pull`, (N,) 1/s, and the damping ratio `damping`, (N,);
    frequency 0 is not pulled. acceleration: (N, 3) m/s2 from outside, or None.
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
            f"{name}: needs {math.ceil(1.0 / max(step * settings.safety, 1e-9))} substeps a second, "
            f"{MOST_SUBSTEPS_PER_SECOND} at most are made: a face of it is too narrow, or its fabric too stiff for "
            "its weight"
        )
    return Solver(cloth, body, settings, step)


def start(solver: Solver, vertices: NDArray) -> State:
    """Start at rest at (N, 3) m."""
    origin = np.asarray(vertices, np.float64).mean(0)
    positions = (vertices - origin).astype(np.float32)
    return State(positions, np.zeros_like(positions), origin, np.zeros(3), no_pairs())


def step(solver: Solver, state: State, motion: Motion) -> State:
    """Simulate one frame.

    The frame of reference moves evenly with the mean of the targets, which keeps numbers small where a body
    walks far. A frame in which cloth flies apart is made again with more substeps; if that does not help, the
    state is as it is, with numbers that are not finite or too large, and whoever steps has to look.
    """
    origin, end, drift = moving_frame(motion.target_start, motion.target_end, motion.seconds)
    began = (state.positions + (state.origin - origin)).astype(np.float32)
    speeds = (state.velocities + (state.drift - drift)).astype(np.float32)
    local = [
        np.ascontiguousarray(points - place, np.float32)
        for points, place in (
            (motion.body_start, origin),
            (motion.body_end, end),
            (motion.target_start, origin),
            (motion.target_end, end),
        )
    ]
    settings, particles = solver.settings, solver.cloth.particles
    acceleration = motion.acceleration
    if acceleration is None:
        acceleration = np.zeros((0, 3), np.float32)
    count = _substeps(solver, began, motion.seconds)
    for attempt in range(RETRIES + 1):
        substeps = count << attempt
        positions, velocities = began.copy(), speeds.copy()
        pairs = _advance(
            solver.cloth.membrane,
            solver.cloth.hinges,
            particles,
            solver.cloth.sheet,
            solver.body,
            tuple(local),
            motion.pull,
            motion.damping,
            acceleration,
            tuple(np.float32(value) for value in drift),
            positions,
            velocities,
            state.pairs,
            substeps,
            max(1, round(substeps * settings.interval / motion.seconds)),
            settings.self_contact,
            np.float32(motion.seconds),
            np.float32(settings.radius),
            np.float32(settings.self_radius),
            np.float32(settings.self_margin),
            np.float32(settings.reach),
            np.float32(solver.cloth.friction),
        )
        if np.isfinite(positions).all() and np.abs(velocities).max(initial=0.0) < FASTEST:
            break
    return State(positions, velocities, end, drift, pairs, substeps)


def moving_frame(
    start: NDArray, end: NDArray, seconds: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Frame of reference of a frame: where it is, m, before and after, and its speed, m/s, (3,) each.

    start, end: (N, 3) m, the targets before and after the frame of `seconds`.
    """
    origin, destination = (np.asarray(points, np.float64).mean(0) for points in (start, end))
    return origin, destination, (destination - origin) / seconds


def _substeps(solver: Solver, positions: Floats, seconds: float) -> int:
    """Substeps of a frame: from the longest stable step, shortened where the cloth is stretched."""
    cloth, settings = solver.cloth, solver.settings
    raised = stiffening(cloth.membrane, positions, cloth.particles.inverse_mass)
    needed = seconds * raised / (settings.safety * solver.stable_step)
    most = MOST_SUBSTEPS_PER_SECOND * seconds
    return max(1, math.ceil(settings.substeps * seconds), math.ceil(min(needed, most)))


@compiled
def _advance(
    membrane,
    hinges,
    particles,
    sheet,
    body,
    local,
    pull,
    damping,
    acceleration,
    drift,
    positions,
    velocities,
    pairs,
    substeps,
    interval,
    self_contact,
    seconds,
    radius,
    self_radius,
    self_margin,
    reach,
    friction,
):
    """Move positions and velocities through the substeps of a frame; returns the pairs of cloth at its end."""
    body_start, body_end, target_start, target_end = local
    count = len(positions)
    step = seconds / np.float32(substeps)
    forces = np.empty_like(positions)
    rounded = np.zeros((count, 3), np.float64)
    normals, body_boxes = np.empty_like(body_start), np.empty((len(body.tree.ranges), 6), np.float32)
    sheet_boxes = np.empty((len(sheet.tree.ranges), 6), np.float32)
    sheet_speeds = np.empty_like(sheet_boxes)
    cones = np.empty((len(sheet.tree.ranges), 5), np.float32)
    points = np.empty_like(body_start)
    pulled = np.nonzero(pull)[0]
    parts = len(body.tree.roots)
    hints = np.full(body.touches.shape, -1, np.int32)
    contacts = find_contacts(body, body_start, normals, body_boxes, positions[:0], reach, hints[:, :0])
    point_wait, edge_wait = np.zeros(0, np.int32), np.zeros(0, np.int32)
    for substep in range(substeps):
        share = np.float32(substep + 1) / np.float32(substeps)
        for i in range(count):
            forces[i, 0] = forces[i, 1] = np.float32(0.0)
            forces[i, 2] = -GRAVITY * particles.weight[i] * particles.mass[i]
        add_elastic_forces(membrane, hinges, positions, velocities, drift, forces)
        for i in pulled:
            rate = pull[i]
            for j in range(3):
                way = target_end[i, j] - target_start[i, j]
                error = target_start[i, j] + share * way - positions[i, j]
                lag = way / seconds - velocities[i, j]
                forces[i, j] += particles.mass[i] * rate * (rate * error + TWO * damping[i] * lag)
        if len(acceleration):
            for i in range(count):
                for j in range(3):
                    forces[i, j] += particles.mass[i] * acceleration[i, j]
        for i in range(count):
            for j in range(3):
                velocities[i, j] += step * particles.inverse_mass[i] * forces[i, j]
                # In float32 alone, what a slow vertex moves in a substep is lost in rounding.
                exact = np.float64(positions[i, j]) + rounded[i, j] + np.float64(step) * velocities[i, j]
                positions[i, j] = np.float32(exact)
                rounded[i, j] = exact - np.float64(positions[i, j])
        if self_contact:
            if substep % interval == 0:
                pairs = find_pairs(
                    sheet,
                    positions,
                    velocities,
                    self_radius + self_margin,
                    step * np.float32(interval),
                    pairs,
                    sheet_boxes,
                    sheet_speeds,
                    cones,
                )
                point_wait = np.zeros(len(pairs.points), np.int32)
                edge_wait = np.zeros(len(pairs.edges), np.int32)
            resolve_pairs(
                pairs,
                point_wait,
                edge_wait,
                sheet,
                positions,
                velocities,
                particles.inverse_mass,
                self_radius,
                friction,
                step,
            )
        if parts > 0:
            if substep % interval == 0:
                for i in range(len(points)):
                    for j in range(3):
                        points[i, j] = (ONE - share) * body_start[i, j] + share * body_end[i, j]
                contacts = find_contacts(body, points, normals, body_boxes, positions, reach, hints)
            resolve_contacts(
                contacts,
                body,
                body_start,
                body_end,
                share,
                normals,
                positions,
                velocities,
                particles.thickness,
                radius,
                friction,
                step,
                seconds,
            )
    return pairs
