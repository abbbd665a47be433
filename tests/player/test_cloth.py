"""The cloth solver of the runtime: what it refuses, and the same bits from the same input."""

import pickle
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from tests.physics.cloth.stepping import solver, still_frames
from tests.simulation.physics.scenes import sheet
from uvcloth.physics.cloth.solver import Solver, start
from uvcloth.physics.fabric import Fabric
from uvcloth.player.cloth import ClothSolver, Elastic


def sections(made: Solver) -> Mapping[str, NDArray[Any]]:
    return {**made.cloth.sections(), **made.body.sections()}


def test_cloth_that_does_not_fit_together_is_refused_with_a_sentence() -> None:
    whole = sections(solver(*sheet(0.2, 0.2, 4, 4)))
    for name, wrong, said in (
        ("particles.mass", np.zeros(16), "vertex 0 of the outfit has no mass"),
        ("hinges.corners", np.full_like(whole["hinges.corners"], 99), "has the index 99"),
        ("membrane.area", whole["membrane.area"][1:], "has 17 rows, 18 were expected"),
        ("cloth.crossed", np.zeros(15, int), "crossed of the outfit has 15 rows, 16 were expected"),
    ):
        with pytest.raises(ValueError, match=said):
            ClothSolver.of({**whole, name: wrong})
    with pytest.raises(ValueError, match="section hinges"):
        Elastic({name: array for name, array in whole.items() if name != "hinges.rest"}, 16)


def test_the_same_input_gives_the_same_bits_after_pickling_too() -> None:
    """Cloth drapes over a ball; it keeps no state of its own."""
    rest, faces = sheet(0.5, 0.5, 16, 16)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    ball.apply_translation([0.22, 0.27, -0.11])
    made = solver(rest, faces, Fabric(), things=[ball])
    ends = [
        still_frames(each, start(each, rest.numpy()), rest, 0.3, things=[ball])[-1]
        for each in (made, made, pickle.loads(pickle.dumps(made)))
    ]
    assert len(ends[0].pairs.points) > 0
    assert np.abs(ends[0].vertices() - rest.numpy()).max() > 0.1
    for end in ends[1:]:
        np.testing.assert_array_equal(end.positions, ends[0].positions)
        np.testing.assert_array_equal(end.velocities, ends[0].velocities)
