"""The cloth solver: symplectic Euler in many small substeps, with contact, stepped frame by frame."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uvcloth.errors import InputError
from uvcloth.geometry.units import GRAVITY
from uvcloth.physics.cloth.body_contact import CLOSE, Watch, find_contacts, no_contacts, resolve_contacts
from uvcloth.physics.cloth.caught import find_caught, without_caught
from uvcloth.physics.cloth.cloth import Cloth, Particles, Sheet
from uvcloth.physics.cloth.forces import Hinges, Membrane, add_elastic_forces
from uvcloth.physics.cloth.moving_body import Body, Memory, begin_passage, end_passage, no_memory
from uvcloth.physics.cloth.self_contact import Pairs, find_pairs, no_pairs, resolve_pairs
from uvcloth.physics.cloth.stability import largest_step
from uvcloth.physics.cloth.vectors import TWO, ZERO, Array, Number, Vector, store
from uvcloth.process.compiled import compiled, inlined, is_kept

Floats = NDArray[np.float32]

FALL = np.float32(GRAVITY)
"""Acceleration of gravity, m/s2, as the compiled loop computes with it."""

HOLD, HOLD_DAMPING = 100.0, 0.7
"""Frequency, 1/s, and damping ratio of the springs that hold the band of a garment."""

COMPILING = "compiling the cloth solver, once after an installation (about a minute)"
"""Message while the first step waits for the compiler."""

MOST_SUBSTEPS_PER_SECOND = 60_000
"""Substeps above which cloth is refused: its faces are too small, or it is too stiff, for its mass."""

FASTEST = 200.0
"""Impossible speed of cloth relative to the body, m/s: a frame in which a vertex is faster is repeated."""

FASTEST_BODY = 40.0
"""Greatest speed of a body, m/s, relative to the mean of the cloth, that can be followed."""

WATCHED = np.float32(0.004)
"""Metres more than where cloth touches the body within which it is watched."""

RETRIES = 2
"""Times that a frame is repeated, each with twice the substeps."""


@dataclass(frozen=True)
class Settings:
    """Settings of the solver, in SI units.

    safety: share of the longest stable step that is taken. substeps: per second at least. radius: m, kept
    between cloth and body. self_radius: m, kept between cloth and cloth; self_margin: m more within which
    cloth is watched, plus its motion at the relative speed until the next search. self_contact: False
    leaves it out. reach: m, how near the body, and how deep in it, cloth is looked for.
    renewal: frames from one search of all faces of the body for a vertex to the next. interval: s between
    two searches for the closest faces of the body and for cloth near cloth.
    """

    safety: float = 0.6
    substeps: int = 0
    radius: float = 0.004
    self_radius: float = 0.003
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
    near: Memory
    substeps: int = 0
    frame: int = 0

    def vertices(self) -> NDArray[np.float64]:
        """Positions (N, 3) m in the world."""
        return self.positions + self.origin


class Drive(NamedTuple):
    """A `Motion` in the frame of reference, for the compiled loop; acceleration may have no rows."""

    body_start: Floats
    body_end: Floats
    target_start: Floats
    target_end: Floats
    pull: Floats
    damping: Floats
    acceleration: Floats


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
    still, near = np.zeros_like(positions), no_memory(solver.body)
    return State(positions, still, origin, np.zeros(3), no_pairs(), near)


def step(solver: Solver, state: State, motion: Motion) -> State:
    """Simulate one frame.

    The frame of reference moves evenly with the mean of the targets, which keeps numbers small where a body
    walks far. A frame in which cloth flies apart is repeated with more substeps. If that does not help, the
    returned state has numbers that are not finite or too large: the caller has to check it. Raises
    InputError for a body that is faster than FASTEST_BODY, or whose vertices are not finite.
    """
    origin, end, drift = moving_frame(motion.target_start, motion.target_end, motion.seconds)
    began = (state.positions + (state.origin - origin)).astype(np.float32)
    speeds = (state.velocities + (state.drift - drift)).astype(np.float32)
    drive = Drive(
        _around(motion.body_start, origin),
        _around(motion.body_end, end),
        _around(motion.target_start, origin),
        _around(motion.target_end, end),
        motion.pull,
        motion.damping,
        np.zeros((0, 3), np.float32) if motion.acceleration is None else motion.acceleration,
    )
    settings, cloth = solver.settings, solver.cloth
    needed = motion.seconds * max(settings.substeps, 1.0 / (settings.safety * solver.stable_step))
    # Cloth that moves farther than the reach between two searches could pass through the body.
    body_speed = _fastest(drive.body_end - drive.body_start) / motion.seconds
    if not body_speed <= FASTEST_BODY:
        raise InputError(
            f"the body moves at {body_speed:.0f} m/s past the cloth in a frame, the limit is "
            f"{FASTEST_BODY:.0f} m/s"
        )
    body_interval = min(settings.interval, settings.reach / max(body_speed + _fastest(speeds), 1e-6))
    for attempt in range(RETRIES + 1):
        substeps = math.ceil(needed) << attempt
        positions, velocities = began.copy(), speeds.copy()
        pairs, near = _advance(
            cloth.membrane,
            cloth.hinges,
            cloth.particles,
            cloth.sheet,
            solver.body,
            drive,
            (np.float32(drift[0]), np.float32(drift[1]), np.float32(drift[2])),
            positions,
            velocities,
            state.pairs,
            state.near,
            state.frame,
            settings.renewal,
            substeps,
            max(1, round(substeps * settings.interval / motion.seconds)),
            max(1, int(substeps * body_interval / motion.seconds)),
            settings.self_contact,
            np.float32(motion.seconds),
            np.float32(settings.radius),
            np.float32(settings.self_radius),
            np.float32(settings.self_margin),
            np.float32(settings.reach),
        )
        if np.isfinite(positions).all() and np.abs(velocities).max(initial=0.0) < FASTEST:
            break
    return State(positions, velocities, end, drift, pairs, near, substeps, state.frame + 1)


def _fastest(ways: NDArray) -> float:
    """Greatest length of ways (N, 3)."""
    x, y, z = np.square(ways.T)
    return math.sqrt(float((x + y + z).max(initial=0.0)))


def is_compiled() -> bool:
    """True if the first step needs no compilation, which takes about a minute."""
    return is_kept(_advance)


@compiled
def _around(points: Array, origin: Array) -> Array:
    near = np.empty(points.shape, np.float32)
    for i in range(len(points)):
        for j in range(3):
            near[i, j] = points[i, j] - origin[j]
    return near


def moving_frame(
    start: NDArray, end: NDArray, seconds: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Frame of reference during a frame: its position, m, before and after, and velocity, m/s, (3,) each.

    start, end: (N, 3) m, the targets before and after the frame of `seconds`.
    """
    origin, destination = (np.asarray(points, np.float64).mean(0) for points in (start, end))
    return origin, destination, (destination - origin) / seconds


@compiled
def _advance(
    membrane: Membrane,
    hinges: Hinges,
    particles: Particles,
    sheet: Sheet,
    body: Body,
    drive: Drive,
    drift: Vector,
    positions: Array,
    velocities: Array,
    pairs: Pairs,
    near: Memory,
    frame: int,
    renewal: int,
    substeps: int,
    interval: int,
    body_interval: int,
    self_contact: bool,
    seconds: Number,
    radius: Number,
    self_radius: Number,
    self_margin: Number,
    reach: Number,
) -> tuple[Pairs, Memory]:
    """Move positions and velocities through the substeps of a frame; returns the pairs and search results."""
    step = seconds / np.float32(substeps)
    forces, rounded = np.empty_like(positions), np.zeros(positions.shape, np.float64)
    nodes = len(sheet.tree.ranges)
    sheet_boxes, speeds = np.empty((nodes, 6), np.float32), np.empty((nodes, 6), np.float32)
    cones = np.empty((nodes, 5), np.float32)
    point_wait, edge_wait = np.zeros(0, np.int32), np.zeros(0, np.int32)
    passage = begin_passage(body, drive.body_start, drive.body_end, positions, near, frame, renewal)
    contacts = no_contacts()
    caught = find_caught(body, drive.body_start, positions)
    watched = radius + WATCHED + particles.thickness
    until_next = np.float32(body_interval) / np.float32(substeps)
    watch = Watch(velocities, watched, until_next, seconds, reach, CLOSE)
    pulled = np.nonzero(drive.pull)[0]
    for substep in range(substeps):
        share = np.float32(substep + 1) / np.float32(substeps)
        _weigh(particles, drive.acceleration, forces)
        add_elastic_forces(membrane, hinges, positions, velocities, drift, forces)
        _pull(particles, drive, pulled, share, seconds, positions, velocities, forces)
        _integrate(particles, forces, step, positions, velocities, rounded)
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
                    speeds,
                    cones,
                )
                pairs = without_caught(pairs, sheet, body, caught)
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
                particles.friction,
                step,
            )
        if len(body.faces) > 0:
            if substep % body_interval == 0:
                contacts = find_contacts(body, passage, share, positions, watch)
            resolve_contacts(
                contacts,
                body,
                passage,
                share,
                positions,
                velocities,
                particles.thickness,
                radius,
                particles.friction,
                step,
                seconds,
            )
    return pairs, end_passage(passage, positions)


@inlined
def _weigh(particles: Particles, acceleration: Array, forces: Array) -> None:
    """Set forces (N, 3), N, to the weight plus mass times an acceleration from outside."""
    for i in range(len(forces)):
        store(forces, i, (ZERO, ZERO, -FALL * particles.weight[i] * particles.mass[i]))
    for i in range(len(acceleration)):
        for j in range(3):
            forces[i, j] += particles.mass[i] * acceleration[i, j]


@inlined
def _pull(
    particles: Particles,
    drive: Drive,
    pulled: Array,
    share: Number,
    seconds: Number,
    positions: Array,
    velocities: Array,
    forces: Array,
) -> None:
    """Add the forces of damped springs to the targets, at a share of the way through the frame."""
    for i in pulled:
        rate = drive.pull[i]
        for j in range(3):
            way = drive.target_end[i, j] - drive.target_start[i, j]
            error = drive.target_start[i, j] + share * way - positions[i, j]
            lag = way / seconds - velocities[i, j]
            forces[i, j] += particles.mass[i] * rate * (rate * error + TWO * drive.damping[i] * lag)


@inlined
def _integrate(
    particles: Particles, forces: Array, step: Number, positions: Array, velocities: Array, rounded: Array
) -> None:
    """Symplectic Euler.

    rounded: (N, 3), rounding errors of the float32 positions: without them slow vertices would not move in
    small substeps.
    """
    for i in range(len(positions)):
        for j in range(3):
            velocities[i, j] += step * particles.inverse_mass[i] * forces[i, j]
            exact = np.float64(positions[i, j]) + rounded[i, j] + np.float64(step) * velocities[i, j]
            positions[i, j] = np.float32(exact)
            rounded[i, j] = exact - np.float64(positions[i, j])
