"""The solver against closed forms: energy, periods, the step's limit, and what may not matter to it."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.special import j0
from torch import Tensor

from tests.physics.cloth.energies import damping_matrix, hinge_energy, membrane_energy, stiffness_matrix
from tests.physics.cloth.stepping import VACUUM, frames, solver, still_frames
from tests.simulation.physics.experiments import LIMP, ROPE, rope_theory
from tests.simulation.physics.scenes import G, sheet
from uvcloth.errors import InputError
from uvcloth.physics.cloth.body import make_body
from uvcloth.physics.cloth.cloth import Damping, make_cloth
from uvcloth.physics.cloth.solver import Motion, Settings, Solver, State, make_solver, start, step
from uvcloth.physics.cloth.stability import largest_step
from uvcloth.physics.fabric import FABRICS, Fabric

UNDAMPED = Damping(stretch=0.0, bend=0.0)
NO_BODY = make_body(np.zeros((0, 3)), [], np.zeros((0, 0), bool))


def swinging(
    rows: int = 12, fabric: Fabric = VACUUM, damping: Damping = UNDAMPED, **settings: float
) -> tuple[Solver, State, Tensor, Tensor, Tensor]:
    """A sheet of 0.3 m, level and at rest, held along one edge: solver, state, rest, faces, held."""
    rest, faces = sheet(0.3, 0.3, rows, rows)
    held = rest[:, 0] < 1e-6
    made = solver(rest, faces, fabric, held, damping=damping, **settings)
    return made, start(made, rest.numpy()), rest, faces, held


def test_a_swinging_sheet_keeps_its_energy() -> None:
    """Of cloth without damping and air: of speed, height, stretch and bend, against the height it falls."""
    made, begin, rest, faces, held = swinging(self_contact=False)
    states = still_frames(made, begin, rest, 1.0, fps=120.0, held=held)
    flat, particles = rest.double(), made.cloth.particles
    total = np.array([energy(state, flat, faces, particles.mass, particles.weight, held) for state in states])
    free = particles.mass[~held.numpy()].sum()
    scale = free * G * 0.15
    fallen = max(-(s.vertices()[~held.numpy(), 2]).mean() for s in states)
    assert fallen > 0.12
    assert np.abs(total).max() < 0.02 * scale
    assert total.max() < 0.005 * scale


def energy(state: State, rest: Tensor, faces: Tensor, mass: NDArray, weight: NDArray, held: Tensor) -> float:
    points, speeds = torch.from_numpy(state.vertices()), state.velocities.astype(np.float64) + state.drift
    pulled = np.where(held.numpy()[:, None], 100.0**2 * (state.vertices() - rest.numpy()) ** 2, 0.0)
    carried = mass * (weight * G * state.vertices()[:, 2] + 0.5 * (speeds**2 + pulled).sum(1))
    elastic = membrane_energy(points, rest, faces, VACUUM) + hinge_energy(points, rest, faces, VACUUM)
    return float(carried.sum() + elastic)


@pytest.mark.parametrize("rows", [20, 30, pytest.param(60, marks=pytest.mark.thorough)])
def test_a_hanging_sheet_swings_with_the_period_of_a_rope_at_any_resolution(rows: int) -> None:
    length = 0.3
    rest, faces = sheet(length, length, rows, rows)
    held = rest[:, 0] < 1e-6
    mode = j0(2.0 * ROPE * ((length - rest[:, 0]) / length).sqrt().numpy())
    hanging = torch.stack([torch.from_numpy(0.02 * mode).float(), rest[:, 1], -rest[:, 0]], 1)
    made = solver(hanging, faces, LIMP, held, self_contact=False)
    states = still_frames(made, start(made, hanging.numpy()), hanging, 1.2, fps=60.0, held=held)
    way = np.array([state.vertices()[-rows:, 0].mean() for state in states])
    at = np.nonzero(way[1:] * way[:-1] < 0.0)[0]
    times = (at + way[at] / (way[at] - way[at + 1])) / 60.0
    assert times[2] - times[0] == pytest.approx(rope_theory(length), rel=0.03)


def test_a_step_is_the_same_twice_and_leaves_its_state_alone() -> None:
    made, begin, rest, _, held = swinging()
    before = still_frames(made, begin, rest, 0.2, held=held)[-1]
    copies = before.positions.copy(), before.velocities.copy(), *map(np.copy, vars(before.pairs).values())
    first, second = (still_frames(made, before, rest, 0.1, held=held)[-1] for _ in range(2))
    assert first.positions.tobytes() == second.positions.tobytes()
    assert first.velocities.tobytes() == second.velocities.tobytes()
    assert np.abs(first.positions - before.positions).max() > 0.01
    for kept, now in zip(
        copies, (before.positions, before.velocities, *vars(before.pairs).values()), strict=True
    ):
        np.testing.assert_array_equal(kept, now)
    whole = still_frames(made, begin, rest, 0.3, held=held)[-1]
    assert whole.positions.tobytes() == first.positions.tobytes()


def test_frames_of_another_length_make_the_same_motion() -> None:
    made, begin, rest, _, held = swinging()
    slow, fast = (still_frames(made, begin, rest, 0.4, fps, held)[-1].vertices() for fps in (30.0, 120.0))
    assert np.abs(slow - fast).max() < 0.002
    assert np.abs(slow - rest.numpy()).max() > 0.2


def test_a_step_is_the_same_wherever_its_arrays_lie_in_memory() -> None:
    """Loops are compiled in two ways, for arrays that may overlap and others, which round otherwise."""
    ends, draw = set(), np.random.default_rng(0)
    for _ in range(40):
        between = [np.empty(size, np.float32) for size in draw.integers(1, 6000, 30)]
        made, begin, rest, _, held = swinging()
        states = still_frames(made, begin, rest, 0.3, held=held)
        ends.add(states[-1].positions.tobytes() + states[-1].velocities.tobytes())
        del between
    assert len(ends) == 1


def test_cloth_is_carried_a_hundred_metres_away_as_if_it_were_here() -> None:
    """Targets that go on by 1 m/s, from the origin and from 100 m away."""
    made, begin, rest, _, held = swinging(damping=Damping())
    time = np.arange(13)[:, None, None] / 30.0
    way = rest.numpy() + time * np.array([1.0, 0.0, 0.0])
    nothing = np.zeros((13, 0, 3))
    far = np.array([100.0, -100.0, 100.0])
    here = list(frames(made, begin, way, nothing, 30.0, held))[-1]
    there = list(frames(made, start(made, rest.numpy() + far), way + far, nothing, 30.0, held))[-1]
    assert np.abs(here.vertices() - way[-1]).max() > 0.1
    np.testing.assert_allclose(there.vertices() - far, here.vertices(), rtol=0.0, atol=1e-4)


def test_an_acceleration_from_outside_is_gravity_in_another_direction() -> None:
    """A sheet on its side, under gravity turned by 90 degrees, does what the level one does."""
    fabric = replace(VACUUM, bend=1e-4)
    rest, faces = sheet(0.2, 0.2, 9, 9)
    side = torch.stack([rest[:, 2], rest[:, 1], -rest[:, 0]], 1)
    pull = np.full((len(rest), 3), [-G, 0.0, G], np.float32)
    ends = []
    for points, outside in ((rest, None), (side, -pull * [-1.0, 1.0, -1.0])):
        made = solver(points, faces, fabric, self_contact=False)
        held = rest[:, 0] < 0.03
        acceleration = None if outside is None else outside.astype(np.float32)
        ends.append(
            still_frames(made, start(made, points.numpy()), points, 0.3, 30.0, held, (), acceleration)[-1]
        )
    level, turned = (end.vertices() for end in ends)
    assert level[:, 2].min() < -0.1
    np.testing.assert_allclose(
        np.stack([-turned[:, 2], turned[:, 1], turned[:, 0]], 1), level, rtol=0.0, atol=1e-4
    )


def test_a_pull_with_critical_damping_brings_cloth_to_its_target_as_its_closed_form_says() -> None:
    """Off by e0 at rest, it is off by e0 (1 + w t) exp(-w t); the target goes on evenly meanwhile."""
    rest, faces = sheet(0.1, 0.1, 5, 5)
    made = solver(rest, faces, self_contact=False, substeps=10_000)
    rate, drift, off = 15.0, np.array([0.5, 0.0, 0.2]), np.array([0.05, -0.03, 0.08])
    times = np.arange(13) / 60.0
    state = replace(start(made, rest.numpy() + off), velocities=np.full((25, 3), drift, np.float32))
    ways = rest.numpy() + times[:, None, None] * drift
    pull, ratio = np.full(25, rate, np.float32), np.ones(25, np.float32)
    lift = np.full((25, 3), [0.0, 0.0, G], np.float32)
    body = np.zeros((0, 3))
    for frame in range(1, 13):
        motion = Motion(1.0 / 60.0, body, body, ways[frame - 1], ways[frame], pull, ratio, lift)
        state = step(made, state, motion)
        left = (1.0 + rate * times[frame]) * math.exp(-rate * times[frame])
        expected = np.broadcast_to(left * off, (25, 3))
        np.testing.assert_allclose(state.vertices() - ways[frame], expected, rtol=0.0, atol=1e-4)


def test_the_stable_step_is_that_of_tension_however_soft_compression_is() -> None:
    rest, faces = sheet(0.3, 0.3, 8, 8)
    soft, stiff = (
        make_cloth(rest.numpy(), faces.numpy(), VACUUM, compression=share, damping=UNDAMPED)
        for share in (0.3, 1.0)
    )
    points = rest.numpy().astype(np.float32)
    assert largest_step(soft, points) == pytest.approx(largest_step(stiff, points), rel=1e-6)


def test_garments_of_two_fabrics_move_as_each_does_alone() -> None:
    """Two sheets that hang by one side, a metre apart, in one cloth; each falls otherwise than the other."""
    rest, faces = sheet(0.2, 0.2, 7, 7)
    count, fabrics = len(rest), (FABRICS["silk"], FABRICS["denim"])
    cloth = {"substeps": 6000, "self_contact": False, "moved_mass": 0.0}
    held = rest[:, 0] < rest[:, 0].min() + 1e-3
    both, every = torch.cat([rest, rest + torch.tensor([0.0, 1.0, 0.0])]), torch.cat([faces, faces + count])
    of = np.repeat([0, 1], len(faces))
    made = solver(both, every, fabrics, held.repeat(2), fabric_of=of, **cloth)
    together = _fallen(made, both, held.repeat(2))
    silk, denim = (_fallen(solver(rest, faces, each, held, **cloth), rest, held) for each in fabrics)
    np.testing.assert_allclose(together, np.concatenate([silk, denim]), rtol=0.0, atol=2e-5)
    assert np.abs(silk - denim).max() > 0.005


def _fallen(made: Solver, rest: Tensor, held: Tensor) -> NDArray[np.float64]:
    """Displacements (N, 3) m after a quarter of a second."""
    return still_frames(made, start(made, rest.numpy()), rest, 0.25, held=held)[-1].vertices() - rest.numpy()


def test_moved_mass_is_taken_from_none_and_cloth_falls_as_before() -> None:
    """A sheet with a sliver: one of its vertices gets several times its mass, all together weigh alike."""
    rest, faces = with_sliver(0.05)
    plain, moved = (solver(rest, faces, moved_mass=share, self_contact=False) for share in (0.0, 0.05))
    masses, before = moved.cloth.particles.mass, plain.cloth.particles.mass
    area = 0.2 * 0.2
    assert before.sum() == pytest.approx(VACUUM.density * area, rel=1e-5)
    assert masses.sum() == pytest.approx(VACUUM.density * area, rel=1e-5)
    assert (masses / before).max() > 2.0
    assert moved.stable_step > 2.0 * plain.stable_step
    end = still_frames(moved, start(moved, rest.numpy()), rest, 0.3)[-1]
    substep = 1.0 / (30.0 * end.substeps)
    fallen = np.zeros((len(rest), 3)) - [0.0, 0.0, 0.5 * G * 0.3 * (0.3 + substep)]
    np.testing.assert_allclose(end.vertices() - rest.numpy(), fallen, rtol=0.0, atol=5e-6)


def with_sliver(height: float) -> tuple[Tensor, Tensor]:
    """A level sheet of 0.2 m, one vertex of which lies a share of an edge's length off the next column."""
    rest, faces = sheet(0.2, 0.2, 9, 9)
    rest[40, 0] = rest[49, 0] - height * 0.025
    return rest, faces


@pytest.mark.parametrize("damping", [UNDAMPED, Damping(), Damping(stretch=1e-3, bend=2e-2)])
@pytest.mark.parametrize("bend", [3e-5, 1e-2])
def test_the_longest_step_is_that_of_the_exact_eigenvalues(damping: Damping, bend: float) -> None:
    """Of stretch with the first rigidity, of bending with the second; a step just below it is stable."""
    fabric = Fabric(drag=0.0, bend=bend)
    rest, faces = sheet(0.1, 0.08, 6, 5)
    rest[:, :2] += 0.003 * torch.randn(len(rest), 2, generator=torch.manual_seed(0))
    cloth = make_cloth(rest.numpy(), faces.numpy(), fabric, damping=damping)
    found = largest_step(cloth, rest.numpy())
    root = np.repeat(cloth.particles.mass.astype(np.float64) ** -0.5, 3)
    stiffness, viscosity = (
        root[:, None] * matrix.numpy() * root
        for matrix in (
            stiffness_matrix(rest.double(), faces, fabric),
            damping_matrix(rest.double(), faces, fabric, damping),
        )
    )
    k, c = (np.linalg.eigvalsh(matrix)[-1] for matrix in (stiffness, viscosity))
    assert found == pytest.approx((math.sqrt(c * c + 4.0 * k) - c) / k, rel=0.02)
    assert growth(stiffness, viscosity, 0.97 * found) < 1.0 + 1e-6
    if damping == UNDAMPED:
        assert growth(stiffness, viscosity, 1.03 * found) > 1.05


def growth(stiffness: NDArray, viscosity: NDArray, step: float) -> float:
    """Greatest factor by which a step of symplectic Euler makes a motion grow."""
    one = np.eye(len(stiffness))
    faster = np.concatenate([one - step * viscosity, -step * stiffness], 1)
    farther = np.concatenate([step * faster[:, : len(one)], one + step * faster[:, len(one) :]], 1)
    return float(np.abs(np.linalg.eigvals(np.concatenate([faster, farther]))).max())


def test_cloth_that_needs_too_many_substeps_is_refused_by_name() -> None:
    square, halves = sheet(0.2, 0.2, 9, 9)
    narrow, _ = with_sliver(1e-4)
    stiff = Fabric(density=0.01, stretch=1e4)
    doubled = square.clone()
    doubled[40] = doubled[41]
    for rest, fabric in ((square, stiff), (narrow, Fabric()), (doubled, Fabric())):
        cloth = make_cloth(rest.numpy(), halves.numpy(), fabric, moved_mass=0.0)
        with pytest.raises(InputError, match=r"skirt: needs \d+ substeps a second, the limit is 60000"):
            make_solver(cloth, rest.numpy(), NO_BODY, Settings(), "skirt")


def test_a_vertex_without_faces_has_a_mass() -> None:
    """Else it is divided by."""
    rest, faces = sheet(0.2, 0.2, 9, 9)
    alone = torch.cat([rest, torch.tensor([[0.5, 0.0, 0.0]])])
    particles = make_cloth(alone.numpy(), faces.numpy(), Fabric()).particles
    assert all(np.isfinite(values).all() for values in (1.0 / particles.mass, particles.weight))
