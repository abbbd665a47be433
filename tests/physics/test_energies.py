"""Energies of cloth by hand, against finite differences, against each other and against the cloth solver."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from tests.physics.cloth.energies import membrane_energy
from tests.physics.cloth.stepping import elastic_forces
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.geometry.operators import sampling
from uvcloth.geometry.units import GRAVITY
from uvcloth.physics.cloth.body import make_body
from uvcloth.physics.cloth.cloth import Damping, make_cloth
from uvcloth.physics.cloth.solver import Motion, Settings, make_solver, start, step
from uvcloth.physics.energies import (
    ClothEnergies,
    attachment_energy,
    cloth_energies,
    collision_energy,
    join_energies,
)
from uvcloth.physics.fabric import AIR_DENSITY, Fabric

FABRIC = Fabric(density=0.3, stretch=30.0, poisson=0.25, bend=0.2, drag=1.3)
SQUARE = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=torch.float64)
HALVES = torch.tensor([[0, 1, 2], [0, 2, 3]])
EQUILATERAL = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0.5, 0.75**0.5, 0]], dtype=torch.float64)
SECONDS = 0.1

Term = Callable[[ClothEnergies, Tensor], Tensor]

TERMS: dict[str, Term] = {
    "springs": ClothEnergies.springs,
    "membrane": ClothEnergies.membrane,
    "membrane that gives way": lambda cloth, x: cloth.membrane(x, compression=0.3),
    "folds": ClothEnergies.folds,
    "hinges": ClothEnergies.hinges,
    "gravity": ClothEnergies.gravity,
    "inertia": lambda cloth, x: cloth.inertia(x, 0.8 * x.detach() + 0.1, 0.7 * x.detach(), SECONDS),
    "air": lambda cloth, x: cloth.air(x, x.detach() + moved_by(len(cloth.masses)), SECONDS),
    "collision": lambda cloth, x: collision_energy(x[..., 2], 0.1, 25.0)[..., None],
    "attachment": lambda cloth, x: attachment_energy(x, torch.linspace(1.0, 2.0, x.shape[-2]))[..., None],
}
INTERNAL = ("springs", "membrane", "membrane that gives way", "folds", "hinges")


def moved_by(count: int) -> Tensor:
    return torch.randn(count, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(9))


def grid(rows: int, columns: int) -> tuple[Tensor, Tensor]:
    """A flat sheet with a vertex every metre."""
    points = torch.cartesian_prod(torch.arange(float(rows)), torch.arange(float(columns)), torch.zeros(1))
    corners = torch.arange(rows * columns).view(rows, columns)
    a, b, c, d = (
        x.flatten() for x in (corners[:-1, :-1], corners[1:, :-1], corners[:-1, 1:], corners[1:, 1:])
    )
    return points.double(), torch.cat([torch.stack([a, b, d], 1), torch.stack([a, d, c], 1)])


def crumpled(seed: int) -> tuple[Tensor, ClothEnergies]:
    """Three shapes (3, 12, 3) of a sheet of a dozen vertices that is curved at rest."""
    flat, faces = grid(4, 3)
    noise = torch.randn(4, 12, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    rest = flat + 0.05 * noise[3]
    return flat + 0.2 * noise[:3], cloth_energies(rest, faces, FABRIC)


def turned() -> Tensor:
    return torch.linalg.matrix_exp(torch.tensor([[0.0, -0.4, 0.1], [0.4, 0, 0.2], [-0.1, -0.2, 0]]).double())


@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("seed", [0, 1])
def test_terms_agree_with_finite_differences(name: str, seed: int) -> None:
    """Of inertia and air, the places before are held."""
    vertices, cloth = crumpled(seed)
    before, earlier = vertices + 0.1, 0.7 * vertices
    fixed = {
        "inertia": lambda x: cloth.inertia(x, before, earlier, SECONDS),
        "air": lambda x: cloth.air(x, vertices.detach() + moved_by(12), SECONDS),
    }
    energy = fixed.get(name, lambda x: TERMS[name](cloth, x))
    assert torch.autograd.gradcheck(energy, vertices.clone().requires_grad_())


@pytest.mark.parametrize("name", TERMS)
def test_many_poses_have_the_energies_of_each(name: str) -> None:
    vertices, cloth = crumpled(2)
    one_by_one = torch.stack([TERMS[name](cloth, each) for each in vertices])
    assert one_by_one.shape == (3, 1)
    torch.testing.assert_close(TERMS[name](cloth, vertices), one_by_one)
    nested = TERMS[name](cloth, vertices.view(3, 1, 12, 3))
    torch.testing.assert_close(nested, one_by_one[:, None])


@pytest.mark.parametrize("name", [*INTERNAL, "gravity", "inertia"])
def test_outfits_side_by_side_have_the_energies_of_each(name: str) -> None:
    """Of other meshes, and of other fabrics."""
    first, cloth = crumpled(3)
    flat, faces = grid(2, 5)
    second = flat + 0.1 * moved_by(10) * torch.arange(1.0, 4.0)[:, None, None]
    other = cloth_energies(flat, faces, Fabric(density=0.1, stretch=70.0, bend=0.01))
    both = join_energies([cloth, other, cloth])
    found = TERMS[name](both, torch.cat([first, second, first.flip(0)], dim=1))
    expected = [TERMS[name](cloth, first), TERMS[name](other, second), TERMS[name](cloth, first.flip(0))]
    torch.testing.assert_close(found, torch.cat(expected, dim=1))


@pytest.mark.parametrize("name", INTERNAL)
def test_a_rigid_motion_changes_no_energy_inside_cloth(name: str) -> None:
    vertices, cloth = crumpled(4)
    moved = TERMS[name](cloth, vertices @ turned().T + 3.0)
    torch.testing.assert_close(moved, TERMS[name](cloth, vertices))
    flat, faces = grid(4, 3)
    energies = cloth_energies(flat, faces, FABRIC)
    assert TERMS[name](energies, flat @ turned().T + 3.0).item() == pytest.approx(0.0, abs=1e-12)


def test_a_stretched_spring_pulls_back_by_its_stiffness() -> None:
    """A corner of the square drawn along one of its edges by 1 cm, which hardly changes the other."""
    cloth = cloth_energies(SQUARE, HALVES, replace(FABRIC, stretch=30.0 / (3**0.5 / 2)))
    pulled = SQUARE.clone()
    pulled[3, 1] += 0.01
    other = math.hypot(1.0, 0.01) - 1.0
    assert cloth.springs(pulled).item() == pytest.approx(15.0 * (0.01**2 + other**2))
    pulled.requires_grad_()
    cloth.springs(pulled).backward()
    assert -pulled.grad[0, 1].item() == pytest.approx(30.0 * 0.01)


@pytest.mark.parametrize("strain", [(1e-4, 0.0), (0.0, 1e-4), (1e-4, 1e-4), (1e-4, -3e-5)])
def test_springs_of_even_triangles_are_the_membrane_of_the_same_stiffness(
    strain: tuple[float, float],
) -> None:
    """Half of each spring belongs to the triangle, half to its neighbour; the Poisson ratio is 1/3."""
    cloth = cloth_energies(EQUILATERAL, torch.tensor([[0, 1, 2]]), replace(FABRIC, poisson=1 / 3))
    stretched = EQUILATERAL * torch.tensor([1.0 + strain[0], 1.0 + strain[1], 1.0], dtype=torch.float64)
    assert 0.5 * cloth.springs(stretched).item() == pytest.approx(cloth.membrane(stretched).item(), rel=1e-3)


def test_a_uniaxial_pull_stores_half_the_stiffness_times_the_squared_strain() -> None:
    """Narrowed as it wants to be, a square metre that is 0.1 % longer: Young's modulus times thickness."""
    flat, faces = grid(3, 2)
    cloth = cloth_energies(flat, faces, FABRIC)
    pulled = flat * torch.tensor([1.0 + 1e-3, 1.0 - 0.25 * 1e-3, 1.0], dtype=torch.float64)
    assert cloth.membrane(pulled).item() == pytest.approx(2.0 * 0.5 * 30.0 * 1e-3**2, rel=2e-3)


def test_the_membrane_is_that_of_saint_venant_and_kirchhoff_in_tension() -> None:
    """mu tr(E E) + lambda tr(E)^2 / 2 of the Green strain E, where both principal stretches are above 1."""
    flat, faces = grid(3, 3)
    shift = torch.tensor([[1.3, 0.1, 0.2], [0.05, 1.2, -0.1], [0.0, 0.0, 1.0]], dtype=torch.float64)
    cloth = cloth_energies(flat, faces, FABRIC)
    columns = shift[:2]
    green = 0.5 * (columns @ columns.T - torch.eye(2).double())
    mu, spread = 30.0 / 2.5, 30.0 * 0.25 / (1 - 0.25**2)
    expected = 4.0 * (mu * green.square().sum() + 0.5 * spread * green.trace() ** 2)
    assert torch.linalg.eigvalsh(green).min() > 0
    assert cloth.membrane(flat @ shift).item() == pytest.approx(expected.item())


@pytest.mark.parametrize("compression", [1.0, 0.3])
def test_the_membrane_is_the_same_by_other_formulas(compression: float) -> None:
    vertices, cloth = crumpled(6)
    flat, faces = grid(4, 3)
    cloth = cloth_energies(flat, faces, FABRIC)
    expected = [membrane_energy(each, flat, faces, FABRIC, compression) for each in vertices]
    torch.testing.assert_close(cloth.membrane(vertices, compression)[:, 0], torch.stack(expected))


def test_cloth_squeezed_to_nothing_is_still_pushed_apart() -> None:
    cloth = cloth_energies(EQUILATERAL, torch.tensor([[0, 1, 2]]), FABRIC)
    flat = (EQUILATERAL * torch.tensor([1.0, 1e-6, 1.0]).double()).requires_grad_()
    cloth.membrane(flat).backward()
    assert flat.grad is not None
    assert torch.isfinite(flat.grad).all()
    assert flat.grad[2, 1] < 0.0


@pytest.mark.parametrize("angle", [-2.0, 0.3, math.pi / 2])
def test_a_fold_costs_the_distance_of_its_normals(angle: float) -> None:
    """|n1 - n2|^2 = 2 (1 - cos), which is 2 for a right angle."""
    upright = torch.tensor([0.5, 0.5, 0.0]).double()
    outward = torch.tensor([-0.5, 0.5, 0.0]).double()
    up = torch.tensor([0.0, 0.0, 0.5**0.5]).double()
    corner = upright + math.cos(angle) * outward - math.sin(angle) * up
    folded = torch.cat([SQUARE[:3], corner[None]])
    cloth = cloth_energies(SQUARE, HALVES, replace(FABRIC, bend=5e-5 * 3**0.5))
    assert cloth.folds(folded).item() == pytest.approx(5e-5 * 2 * (1 - math.cos(angle)))
    # The diagonal of 1.41 m lies between faces of half a square metre.
    assert cloth.hinges(folded).item() == pytest.approx(0.5 * 5e-5 * 3**0.5 * 2.0 * angle**2)


def rolled(radius: float) -> tuple[Tensor, Tensor, Tensor]:
    """Even triangles of 1 cm, flat and rolled up across their edges; and their faces."""
    rows, columns = torch.meshgrid(torch.arange(60.0), torch.arange(60.0), indexing="ij")
    x = (columns + 0.5 * (rows % 2)).flatten().double() * 0.01
    y = rows.flatten().double() * 0.01 * 0.75**0.5
    corners = torch.arange(3600).view(60, 60)
    faces = []
    for row in range(59):
        low, high = (corners[row], corners[row + 1])[:: 1 if row % 2 == 0 else -1]
        pair = torch.cat(
            [torch.stack([low[:-1], low[1:], high[:-1]], 1), torch.stack([low[1:], high[1:], high[:-1]], 1)]
        )
        faces.append(pair if row % 2 == 0 else pair.flip(1))
    flat = torch.stack([x, y, torch.zeros_like(x)], 1)
    curved = torch.stack([x, radius * (y / radius).sin(), radius * (y / radius).cos()], 1)
    return flat, curved, torch.cat(faces)


def test_a_plate_rolled_up_stores_half_its_rigidity_times_the_squared_curvature() -> None:
    flat, curved, faces = rolled(0.1)
    cloth = cloth_energies(flat, faces, replace(FABRIC, bend=8e-5))
    expected = 0.5 * 8e-5 / 0.1**2 * float(cloth.areas.sum())
    assert cloth.hinges(curved).item() == pytest.approx(expected, rel=0.04)
    assert cloth.folds(curved).item() == pytest.approx(expected, rel=0.04)


def test_roughness_is_what_normals_differ_by_from_the_mean_around_them() -> None:
    """A pyramid's tip: its four neighbours lean away from it, and it from them."""
    points = torch.tensor([[0.0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])
    cloth = cloth_energies(points, faces, FABRIC)
    linked = torch.ones(5, 5)
    for vertex, opposite in ((1, 3), (2, 4), (3, 1), (4, 2)):
        linked[vertex, opposite] = 0.0
    shares = linked / linked.sum(1, keepdim=True)
    average = sampling(torch.arange(5).expand(5, 5), shares, 5)
    normals = vertex_normals(points, faces)[None]
    expected = 0.5 * (normals[0] - shares @ normals[0]).square().sum()
    assert cloth.roughness(normals, average, 0.5).tolist() == [[pytest.approx(float(expected), rel=1e-5)]]
    flat = vertex_normals(points * torch.tensor([1.0, 1.0, 0.0]), faces)[None]
    assert cloth.roughness(flat, average, 0.5).item() == pytest.approx(0.0, abs=1e-9)


def test_masses_are_the_weight_of_the_sheet_and_lifting_it_takes_m_g_h() -> None:
    mesh = trimesh.creation.icosphere(2)
    cloth = cloth_energies(torch.tensor(mesh.vertices), torch.tensor(mesh.faces), FABRIC)
    assert cloth.masses.sum().item() == pytest.approx(0.3 * mesh.area)
    square = cloth_energies(SQUARE, HALVES, FABRIC)
    assert square.masses.tolist() == pytest.approx([0.1, 0.05, 0.1, 0.05])
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    lifted = square.gravity(torch.stack([SQUARE, SQUARE + up, SQUARE - 2 * up]))
    assert lifted[:, 0].tolist() == pytest.approx([0.0, 0.3 * GRAVITY, -0.6 * GRAVITY])


def test_where_inertia_and_gravity_balance_cloth_falls_freely() -> None:
    cloth = cloth_energies(SQUARE, HALVES, FABRIC)
    before, earlier = SQUARE + 0.02, SQUARE - 0.01
    falls = 2.0 * before - earlier - torch.tensor([0.0, 0.0, GRAVITY * SECONDS**2], dtype=torch.float64)
    falls.requires_grad_()
    (cloth.inertia(falls, before, earlier, SECONDS) + cloth.gravity(falls)).backward()
    assert falls.grad is not None
    assert falls.grad.abs().max() < 1e-12
    moved = cloth.inertia(SQUARE + 0.03, SQUARE, SQUARE, SECONDS)
    assert moved.item() == pytest.approx(0.3 * 3 * 0.03**2 / (2 * SECONDS**2))


def test_air_takes_the_power_that_drag_has() -> None:
    """The square metre moves at 2 m/s along its normal and 5 m/s across it."""
    cloth = cloth_energies(SQUARE, HALVES, FABRIC)
    way = SECONDS * torch.tensor([5.0, 0.0, 2.0]).double()
    moved = (SQUARE + way).requires_grad_()
    energy = cloth.air(moved, SQUARE, SECONDS)
    drag = 0.5 * AIR_DENSITY * 1.3 * 2.0**2
    assert energy.item() == pytest.approx(SECONDS * drag * 2.0 / 3.0)
    energy.backward()
    assert moved.grad is not None
    assert moved.grad.sum(0).tolist() == pytest.approx([0.0, 0.0, drag])


def test_only_what_lacks_thickness_is_pushed() -> None:
    """A point 1 mm inside lacks 5 mm of a 4 mm thickness, one 3 mm outside 1 mm, one 5 mm outside nothing."""
    distance = torch.tensor([-0.001, 0.003, 0.005, 1e6], dtype=torch.float64, requires_grad=True)
    energy = collision_energy(distance, 0.004, 50.0)
    assert energy.item() == pytest.approx(25.0 * (0.005**2 + 0.001**2))
    energy.backward()
    assert distance.grad.tolist() == pytest.approx([-50.0 * 0.005, -50.0 * 0.001, 0.0, 0.0])


def test_an_attached_vertex_pays_for_its_offset() -> None:
    offsets = torch.tensor([[[0.01, 0.0, 0.0], [0.0, 0.0, 0.02]], [[0.0, 0.0, 0.0]] * 2])
    assert attachment_energy(offsets, 20.0).tolist() == pytest.approx([10.0 * (1e-4 + 4e-4), 0.0])
    each = attachment_energy(offsets, torch.tensor([20.0, 2.0]))
    assert each.tolist() == pytest.approx([10.0 * 1e-4 + 1.0 * 4e-4, 0.0])


# The same cloth in the solver, which computes in float32.

CLOTH = Fabric(density=0.2, stretch=40.0, poisson=0.3, bend=1e-4, drag=1.1)
UNDAMPED = Damping(stretch=0.0, bend=0.0)


def uneven() -> tuple[Tensor, Tensor]:
    """A sheet of 0.2 m whose vertices lie off their places and off the plane."""
    flat, faces = grid(9, 9)
    return 0.025 * flat + 0.002 * moved_by(81), faces


def deformed(rest: Tensor, bumps: float) -> Tensor:
    """Points moved by a linear map, and each by some millimetres."""
    generator = torch.Generator().manual_seed(1)
    turn = torch.eye(3).double() + 0.1 * torch.randn(3, 3, dtype=torch.float64, generator=generator)
    return rest @ turn.T + bumps * torch.randn(rest.shape, dtype=torch.float64, generator=generator)


def solver_forces(fabric: Fabric, points: Tensor, speeds: Tensor, compression: float = 1.0) -> Tensor:
    """Elastic and air forces (N, 3) N of the solver on the uneven sheet."""
    rest, faces = uneven()
    cloth = make_cloth(rest.numpy(), faces.numpy(), fabric, compression=compression, damping=UNDAMPED)
    return torch.from_numpy(elastic_forces(cloth, points, speeds)).double()


def downhill(energies: Sequence[Tensor], points: Tensor) -> Tensor:
    """Minus the gradient (N, 3) N of the sum of energies."""
    (slope,) = torch.autograd.grad(torch.stack([each.sum() for each in energies]).sum(), points)
    return -slope


def assert_like(found: Tensor, expected: Tensor, share: float) -> None:
    torch.testing.assert_close(found, expected, rtol=0.0, atol=share * float(expected.abs().max()))


@pytest.mark.parametrize("compression", [1.0, 0.5])
def test_the_solvers_membrane_pulls_down_the_slope_of_the_energy(compression: float) -> None:
    rest, faces = uneven()
    fabric = replace(CLOTH, bend=0.0)
    points = deformed(rest, 0.003).requires_grad_()
    expected = downhill([cloth_energies(rest, faces, fabric).membrane(points, compression)], points)
    found = solver_forces(fabric, points.detach(), torch.zeros_like(rest), compression)
    assert_like(found, expected, 2e-5)


def test_the_solvers_hinges_turn_down_the_slope_of_the_energy() -> None:
    """Without stretch: what the solver adds to the membrane's forces."""
    rest, faces = uneven()
    points = deformed(rest, 0.0015).requires_grad_()
    stiff = replace(CLOTH, bend=1e-2)
    expected = downhill([cloth_energies(rest, faces, stiff).hinges(points)], points)
    found, limp = (
        solver_forces(fabric, points.detach(), torch.zeros_like(rest))
        for fabric in (stiff, replace(stiff, bend=0.0))
    )
    assert_like(found - limp, expected, 1e-4)


def test_the_solvers_air_pushes_down_the_slope_of_the_energy() -> None:
    """Where the way from the places before is short, so that normals and areas are those of now."""
    rest, faces = uneven()
    before = deformed(rest, 0.001)
    speeds = 5.0 * moved_by(81)
    seconds = 1e-3
    points = (before + seconds * speeds).requires_grad_()
    expected = downhill([cloth_energies(rest, faces, CLOTH).air(points, before, seconds)], points)
    moving, still = (solver_forces(CLOTH, before, values) for values in (speeds, torch.zeros_like(rest)))
    assert_like(moving - still, expected, 1e-3)


def test_a_step_of_the_solver_balances_inertia_and_all_forces() -> None:
    """Symplectic Euler: the acceleration after a substep is that of the forces before it.

    Some vertices are pulled to their targets; gravity, stretch, bend and air act on all.
    """
    rest, faces = uneven()
    points, speeds, seconds = deformed(rest, 0.001), 2.0 * moved_by(81), 1e-5
    cloth = make_cloth(rest.numpy(), faces.numpy(), CLOTH, damping=UNDAMPED, moved_mass=0.0)
    nothing = make_body(np.zeros((0, 3)), [], np.zeros((0, 81), bool))
    solver = make_solver(cloth, rest.numpy(), nothing, Settings(self_contact=False))
    began = start(solver, points.numpy())
    began = replace(began, velocities=speeds.float().numpy())
    pull = np.zeros(81, np.float32)
    pull[:9] = 50.0
    ends = (np.zeros((0, 3)),) * 2 + (points.numpy() + 0.01,) * 2
    ended = step(solver, began, Motion(seconds, *ends, pull, np.zeros(81, np.float32)))
    assert ended.substeps == 1
    now = torch.from_numpy(began.vertices())
    at, speed, later = (
        values.double() for values in (now, speeds.float(), torch.from_numpy(ended.velocities))
    )
    energies = cloth_energies(rest, faces, CLOTH)
    np.testing.assert_allclose(cloth.particles.mass, energies.masses, rtol=1e-6)
    after = (at + seconds * later).requires_grad_()
    inertia = downhill([energies.inertia(after, at, at - seconds * speed, seconds)], after)
    place = at.clone().requires_grad_()
    stiffness = energies.masses * torch.from_numpy(pull).double() ** 2
    forces = downhill(
        [
            energies.membrane(place),
            energies.hinges(place),
            energies.gravity(place),
            energies.air(place, at - seconds * speed, seconds),
            attachment_energy(place - (points + 0.01), stiffness),
        ],
        place,
    )
    assert_like(-inertia, forces, 1e-3)
