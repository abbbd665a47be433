"""Cloth that a limb takes into another one: found where it is inside, and not in contact there."""

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray

from tests.simulate.physics.scenes import sheet
from uvcloth.geometry.mesh import join_meshes
from uvcloth.physics.cloth.caught import find_caught, without_caught
from uvcloth.physics.cloth.cloth import make_cloth
from uvcloth.physics.cloth.moving_body import Body, make_body
from uvcloth.physics.cloth.self_contact import Pairs, find_pairs, no_pairs
from uvcloth.physics.fabric import Fabric

RADIUS, MARGIN = 0.05, 0.006
SIDE = np.array([0.3, 0.0, 0.0])


def balls(touches: NDArray, crossed: NDArray) -> tuple[Body, NDArray]:
    """Two balls, one at the origin, one 0.3 m to its side."""
    one = trimesh.creation.icosphere(4, radius=RADIUS)
    vertices = np.concatenate([one.vertices, one.vertices + SIDE]).astype(np.float32)
    parts = [one.faces, one.faces + len(one.vertices)]
    return make_body(vertices, parts, touches, crossed), vertices


def test_cloth_is_caught_by_the_balls_that_it_may_cross_where_it_is_inside() -> None:
    points = (
        np.random.default_rng(0)
        .uniform((-0.1, -0.06, -0.06), (0.4, 0.06, 0.06), (4000, 3))
        .astype(np.float32)
    )
    crossed = np.arange(len(points)) % 2 == np.arange(2)[:, None]
    body, vertices = balls(~crossed, crossed)
    depth = RADIUS - np.linalg.norm(points - np.stack([0.0 * SIDE, SIDE])[:, None], axis=2)
    caught = find_caught(body, vertices, points)
    sure = np.abs(depth) > 5e-4  # a ball of faces is that much smaller
    assert np.array_equal(caught[sure], (crossed & (depth > 0.0))[sure])
    assert (caught.sum(1) > 20).all()


def test_pairs_are_left_out_where_one_is_inside_a_ball_that_the_other_touches() -> None:
    """A sheet that touches the ball, another 4 mm above that may be in it, and a third that knows it not."""
    flat, faces = sheet(0.2, 0.2, 21, 21)
    flat = flat - flat.mean(0)
    layers = [(flat + torch.tensor([0.0, 0.0, 0.004 * k]), faces) for k in range(3)]
    joined, count = join_meshes(layers), len(flat)
    points = joined.vertices.numpy()
    layer = np.arange(len(points)) // count
    touches, crossed = np.zeros((2, 2, len(points)), bool)
    touches[0], crossed[0] = layer == 0, layer == 1
    body, vertices = balls(touches, crossed)
    made = make_cloth(points, joined.faces.numpy(), Fabric()).sheet
    nodes = len(made.tree.ranges)
    workspace = [np.empty((nodes, size), np.float32) for size in (6, 6, 5)]
    every: Pairs = find_pairs(
        made, points, np.zeros_like(points), np.float32(MARGIN), np.float32(0), no_pairs(), *workspace
    )
    caught = find_caught(body, vertices, points)
    left: Pairs = without_caught(every, made, body, caught)
    inside = (layer == 1) & (np.linalg.norm(points, axis=1) < RADIUS)
    for pairs, remaining, (ones, others) in (
        (every.points, left.points, (every.points[:, :1], made.faces[every.points[:, 1]])),
        (every.edges, left.edges, (made.edges[every.edges[:, 0]], made.edges[every.edges[:, 1]])),
    ):
        meets = (inside[ones].any(1) & touches[0, others].any(1)) | (
            touches[0, ones].any(1) & inside[others].any(1)
        )
        assert 100 < meets.sum() < 0.5 * len(pairs)
        assert np.array_equal(remaining, pairs[~meets])
    assert len(left.sides) == len(left.points)
    assert len(left.directions) == len(left.edges)
