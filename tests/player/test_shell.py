"""Moving meshes in the runtime: points on them, and rays, beside trimesh's own."""

import pickle

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from uvcloth.player.shell import MovingShell, sample

FAR = 3.0
RAYS = 1003
"""Not a multiple of eight: the last rays are followed alone."""


def ball(radius: float = 1.0) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(3, radius)


def rays(count: int = RAYS) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rays from all around towards the middle, beside it and past it."""
    draw = np.random.default_rng(0)
    starts = draw.normal(size=(count, 3))
    starts *= 2.0 / np.linalg.norm(starts, axis=1, keepdims=True)
    ways = draw.normal(scale=0.8, size=(count, 3)) - starts
    return starts, ways / np.linalg.norm(ways, axis=1, keepdims=True)


def test_rays_meet_the_faces_that_trimesh_finds() -> None:
    mesh = ball()
    mesh.vertices *= (1.0, 0.6, 0.3)
    starts, ways = rays()
    hits = MovingShell(mesh.vertices, mesh.faces).first_hits(starts, ways, FAR)
    places, rows, faces = mesh.ray.intersects_location(starts, ways, multiple_hits=False)
    expected = np.full(RAYS, -1)
    expected[rows] = faces
    assert 0.2 < (expected >= 0).mean() < 0.8
    assert (hits.faces != expected).mean() < 0.002
    same = (hits.faces == expected) & (expected >= 0)
    distances = np.full(RAYS, np.nan)
    distances[rows] = np.linalg.norm(places - starts[rows], axis=1)
    assert np.abs(hits.distances - distances)[same].max() < 1e-5
    met = np.einsum("rc,rcx->rx", hits.weights, mesh.triangles[hits.faces])[same]
    assert np.abs(met - (starts + hits.distances[:, None] * ways)[same]).max() < 1e-5
    assert np.abs(hits.cosines - (mesh.face_normals[hits.faces] * ways).sum(1))[same].max() < 1e-5
    missed = hits.faces < 0
    assert (hits.distances[missed] == 1e9).all()
    assert not hits.weights[missed].any()


def test_a_moved_mesh_is_met_where_it_is_and_no_farther_than_the_reach() -> None:
    mesh, (starts, ways) = ball(), rays()
    shell = MovingShell(mesh.vertices, mesh.faces)
    moved = ball()
    moved.vertices += (0.0, 0.0, 0.7)
    shell.move(moved.vertices)
    once = MovingShell(moved.vertices, moved.faces)
    for each in (shell, pickle.loads(pickle.dumps(shell))):
        assert np.array_equal(
            each.first_hits(starts, ways, FAR).faces, once.first_hits(starts, ways, FAR).faces
        )
    near, far = (shell.first_hits(starts, ways, reach) for reach in (1.5, FAR))
    within = far.distances < 1.5
    assert 0 < within.sum() < (far.faces >= 0).sum()
    assert np.array_equal(near.faces >= 0, within)


def test_no_ray_slips_through_a_corner_or_an_edge() -> None:
    mesh = ball()
    middles = mesh.vertices[mesh.edges_unique].mean(1)
    ways = np.concatenate([mesh.vertices, middles])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    hits = MovingShell(mesh.vertices, mesh.faces).first_hits(np.zeros_like(ways), ways, FAR)
    assert (hits.faces >= 0).all()
    assert (hits.cosines > 0.9).all()


def test_a_mesh_without_faces_is_never_met() -> None:
    shell = MovingShell(np.zeros((3, 3)), np.zeros((0, 3), int))
    shell.move(np.ones((3, 3)))
    assert (shell.first_hits(*rays(9), FAR).faces == -1).all()


@pytest.mark.parametrize("corner", [-1, 3])
def test_a_corner_that_is_no_vertex_is_refused(corner: int) -> None:
    with pytest.raises(ValueError, match=f"face 1 has the corner {corner} of 3 vertices"):
        MovingShell(np.zeros((3, 3)), np.array([[0, 1, 2], [0, 1, corner]]))


def test_points_lie_on_their_faces_with_the_faces_normals() -> None:
    mesh, draw = ball(), np.random.default_rng(1)
    rows, weights = draw.integers(len(mesh.faces), size=RAYS), draw.dirichlet((1, 1, 1), RAYS)
    points, normals = sample(mesh.vertices, mesh.faces[rows], weights)
    assert np.abs(points - np.einsum("pc,pcx->px", weights, mesh.triangles[rows])).max() < 1e-6
    assert np.abs(normals - mesh.face_normals[rows]).max() < 1e-5
