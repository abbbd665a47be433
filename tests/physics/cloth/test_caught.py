"""Cloth that a limb takes into another one: found where it is inside, and not in contact there."""

import numpy as np
import pytest
import torch
import trimesh
from numpy.typing import NDArray

from tests.physics.cloth.stepping import pairs_near
from tests.simulation.physics.scenes import sheet
from uvcloth.geometry.mesh import join_meshes
from uvcloth.physics.cloth.body import Body, make_body
from uvcloth.physics.cloth.cloth import make_cloth
from uvcloth.physics.fabric import Fabric

RADIUS, MARGIN = 0.05, 0.006
SIDE = np.array([0.3, 0.0, 0.0])


def balls(touches: NDArray, crossed: NDArray) -> Body:
    """Two balls, one at the origin, one 0.3 m to its side."""
    one = trimesh.creation.icosphere(4, radius=RADIUS)
    vertices = np.concatenate([one.vertices, one.vertices + SIDE])
    return make_body(vertices, [one.faces, one.faces + len(one.vertices)], touches, crossed)


@pytest.mark.parametrize("ball", [0, 1])
def test_pairs_are_left_out_where_one_is_inside_a_ball_that_the_other_touches(ball: int) -> None:
    """A sheet that touches the ball, another 4 mm above that may be in it, and a third that knows it not.

    Those inside the ball are more than half a millimetre deep, as it is a ball of faces.
    """
    flat, faces = sheet(0.2, 0.2, 21, 21)
    flat = flat - flat.mean(0) + ball * torch.from_numpy(SIDE)
    layers = [(flat + torch.tensor([0.0, 0.0, 0.004 * k]), faces) for k in range(3)]
    joined, count = join_meshes(layers), len(flat)
    points = joined.vertices.double().numpy()
    layer = np.arange(len(points)) // count
    touches, crossed = np.zeros((2, 2, len(points)), bool)
    touches[ball], crossed[ball] = layer == 0, layer == 1
    made = make_cloth(points, joined.faces.numpy(), Fabric())
    every = pairs_near(made, points, MARGIN)
    left = pairs_near(made, points, MARGIN, body=balls(touches, crossed))
    depth = RADIUS - np.linalg.norm(points - ball * SIDE, axis=1)
    assert (np.abs(depth[layer == 1]) > 5e-5).all()
    inside = (layer == 1) & (depth > 0.0)
    for pairs, remaining, (ones, others) in (
        (every.points, left.points, (every.points[:, :1], made.sheet.faces[every.points[:, 1]])),
        (every.edges, left.edges, (made.sheet.edges[every.edges[:, 0]], made.sheet.edges[every.edges[:, 1]])),
    ):
        meets = (inside[ones].any(1) & touches[ball, others].any(1)) | (
            touches[ball, ones].any(1) & inside[others].any(1)
        )
        assert 100 < meets.sum() < 0.5 * len(pairs)
        assert np.array_equal(remaining, pairs[~meets])
    assert len(left.sides) == len(left.points)
    assert len(left.directions) == len(left.edges)
