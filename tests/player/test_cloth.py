"""The solver of the runtime against the one in Python, which it follows to rounding."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from numpy.typing import NDArray

from tests.physics.cloth.stepping import solver
from tests.simulate.physics.scenes import sheet
from uvcloth.physics.cloth.forces import add_elastic_forces
from uvcloth.physics.cloth.solver import Motion, Solver, start, step
from uvcloth.physics.fabric import Fabric
from uvcloth.player.cloth import ClothSolver, Elastic, Searched, no_pairs

FPS, SUBSTEPS, SEARCHES = 30.0, 64, 4


def sections(made: Solver, rest: NDArray, body_rest: NDArray) -> dict[str, NDArray[Any]]:
    """Cloth and body as the runtime reads them."""
    cloth, body = made.cloth, made.body
    tree, faces, edges = cloth.sheet.tree, cloth.membrane.size, cloth.hinges.size
    named: dict[str, NDArray[Any]] = {
        "cloth.rest": rest,
        "cloth.touches": _bits(body.touches),
        "cloth.crossed": _bits(body.crossed),
        "collider.rest": body_rest,
        "collider.faces": body.faces,
        "collider.starts": np.append(body.tree.ranges[body.tree.roots, 0], len(body.faces)),
        "sheet.faces": cloth.sheet.faces,
        "sheet.starts": np.append(tree.ranges[tree.roots, 0], len(cloth.sheet.faces)),
        "sheet.edges": cloth.sheet.edges,
        "sheet.owned": cloth.sheet.owned,
        "sheet.face_edges": cloth.sheet.face_edges,
        "sheet.apart": cloth.sheet.apart,
        "sheet.spacing": np.array([cloth.sheet.spacing]),
        "membrane.corners": cloth.membrane.corners[:, :faces].T,
        "membrane.inverse": cloth.membrane.inverse[:, :faces].T,
        "membrane.reduction": np.array([cloth.membrane.reduction]),
        "hinges.corners": cloth.hinges.corners[:, :edges].T,
        "hinges.floors": cloth.hinges.floors[:, :edges].T,
        "hinges.damping": np.array([cloth.hinges.damping]),
    }
    for name in ("area", "shear", "spread", "damping", "pressure"):
        named[f"membrane.{name}"] = getattr(cloth.membrane, name)[:faces]
    for name in ("stiffness", "rest"):
        named[f"hinges.{name}"] = getattr(cloth.hinges, name)[:edges]
    for name in ("mass", "weight", "thickness", "friction"):
        named[f"particles.{name}"] = getattr(cloth.particles, name)
    return named


def _bits(masks: NDArray[np.bool_]) -> NDArray[np.int64]:
    """A bit for every part, (N,), from masks (K, N)."""
    return (masks * (1 << np.arange(len(masks)))[:, None]).sum(0)


def numbers(made: Solver, frame: int) -> Mapping[str, float]:
    """Settings of a frame, as the solver in Python has them."""
    settings = made.settings
    same = {name: getattr(settings, name) for name in ("radius", "self_radius", "self_margin", "reach")}
    counts = {"substeps": SUBSTEPS, "interval": SUBSTEPS // SEARCHES, "body_interval": SUBSTEPS // SEARCHES}
    clocks = {"hinge_interval": 1, "frame": frame, "renewal": settings.renewal, "self_contact": 1}
    return {**same, **counts, **clocks, "seconds": 1.0 / FPS}


def test_cloth_falls_over_a_ball_as_in_python() -> None:
    """It drapes over the ball, with as many substeps and searches. Rounding grows from frame to frame."""
    rest, faces = sheet(0.5, 0.5, 16, 16)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    ball.apply_translation([0.22, 0.27, -0.11])
    made = solver(rest, faces, Fabric(), things=[ball], substeps=SUBSTEPS * FPS, safety=1.0)
    native = ClothSolver.of(sections(made, rest.numpy(), ball.vertices))
    targets, still = rest.double().numpy(), np.zeros(len(rest), np.float32)
    origin = targets.mean(0)
    body, centred = ((points - origin).astype(np.float32) for points in (ball.vertices, targets))
    state = start(made, targets)
    positions, velocities, pairs = centred.copy(), np.zeros_like(centred), no_pairs()
    searched = Searched(np.full((1, len(rest)), -1, np.int32), np.zeros((1, len(rest)), np.float32))
    arrays = {"body_start": body, "body_end": body, "target_start": centred, "target_end": centred}
    motion = Motion(1.0 / FPS, ball.vertices, ball.vertices, targets, targets, still, still)
    for frame in range(8):
        state = step(made, state, motion)
        assert state.substeps == SUBSTEPS
        positions, velocities, pairs, searched = native.step(
            {**arrays, "pull": still, "damping": still},
            numbers(made, frame),
            np.zeros(3),
            positions,
            velocities,
            pairs,
            searched,
        )
        assert np.linalg.norm(positions - state.positions, axis=1).max() < 1e-4
    assert np.abs(positions - centred).max() > 0.1
    assert len(pairs.points) > 0


def test_forces_are_those_in_python() -> None:
    rest, faces = sheet(0.2, 0.2, 9, 9)
    made = solver(rest, faces, Fabric())
    draw = torch.manual_seed(0)
    points = (1.05 * rest + 0.004 * torch.randn(rest.shape, generator=draw)).numpy()
    speeds = torch.randn(rest.shape, generator=draw).numpy()
    wind = np.array([1.0, -2.0, 0.5], np.float32)
    expected, found = np.zeros_like(points), np.zeros_like(points)
    add_elastic_forces(made.cloth.membrane, made.cloth.hinges, points, speeds, tuple(wind), expected)
    Elastic(sections(made, rest.numpy(), np.zeros((0, 3))), len(rest)).add_forces(points, speeds, found, wind)
    np.testing.assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max())


def test_cloth_that_does_not_fit_together_is_refused_with_a_sentence() -> None:
    rest, faces = sheet(0.2, 0.2, 4, 4)
    whole = sections(solver(rest, faces), rest.numpy(), np.zeros((0, 3)))
    for name, wrong, said in (
        ("particles.mass", np.zeros(len(rest)), "vertex 0 of the outfit has no mass"),
        ("hinges.corners", np.full_like(whole["hinges.corners"], 99), "has the index 99"),
        ("membrane.area", whole["membrane.area"][1:], "has 17 rows, 18 were expected"),
    ):
        with pytest.raises(ValueError, match=said):
            ClothSolver.of({**whole, name: wrong})
