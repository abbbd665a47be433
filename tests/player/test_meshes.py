"""Moving meshes in the runtime: closest points, sides, crossing edges beside trying every face in NumPy."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from uvcloth.player.meshes import MovingMeshes
from uvcloth.player.surface_graph import SurfaceGraph

REACH = 0.25
POINTS = 401
ALL = np.inf
"""Distances are exact however far away they are."""


def crossing_limbs() -> trimesh.Trimesh:
    """Two ellipsoids that cross at the origin: the nearest sheet of one may lie within the other."""
    upright, across = (trimesh.creation.icosphere(2) for _ in range(2))
    upright.apply_scale([0.2, 0.15, 0.6])
    across.apply_scale([0.6, 0.2, 0.17])
    return trimesh.util.concatenate([upright, across])


def cloud(count: int = POINTS, seed: int = 0) -> NDArray[np.float64]:
    """Points within and around the limbs, as float32 has them."""
    return np.random.default_rng(seed).uniform(-0.6, 0.6, (count, 3)).astype(np.float32).astype(float)


def distances_of(triangles: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances (P, F) m of points from triangles (F, 3, 3): from their insides and from their edges."""
    a = triangles[:, 0]
    ab, ac = triangles[:, 1] - a, triangles[:, 2] - a
    normal = np.cross(ab, ac)
    way = points[:, None] - a
    height = (way * normal).sum(-1) / np.linalg.norm(normal, axis=1)
    v = (np.cross(way, ac) * normal).sum(-1) / (normal**2).sum(-1)
    w = (np.cross(ab, way) * normal).sum(-1) / (normal**2).sum(-1)
    best = np.where((v >= 0) & (w >= 0) & (v + w <= 1), np.abs(height), np.inf)
    for corner in range(3):
        start, along = triangles[:, corner], triangles[:, (corner + 1) % 3] - triangles[:, corner]
        share = ((points[:, None] - start) * along).sum(-1) / (along**2).sum(-1)
        off = points[:, None] - start - np.clip(share, 0, 1)[..., None] * along
        best = np.minimum(best, np.linalg.norm(off, axis=-1))
    return best


def turns_around(triangles: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """How often a closed mesh (F, 3, 3) goes around each point, by its solid angles (Van Oosterom 1983)."""
    a, b, c = (triangles[:, corner] - points[:, None] for corner in range(3))
    x, y, z = (np.linalg.norm(each, axis=-1) for each in (a, b, c))
    volume = (a * np.cross(b, c)).sum(-1)
    share = x * y * z + (a * b).sum(-1) * z + (b * c).sum(-1) * x + (c * a).sum(-1) * y
    return np.arctan2(volume, share).sum(1) / (2 * np.pi)


def triangles_of(mesh: trimesh.Trimesh) -> NDArray[np.float64]:
    return mesh.vertices.astype(np.float32).astype(float)[mesh.faces]


def test_closest_points_and_their_sides_are_those_of_all_faces() -> None:
    mesh, points = crossing_limbs(), cloud()
    meshes, triangles = MovingMeshes(mesh.vertices, [mesh.faces]), triangles_of(mesh)
    every = distances_of(triangles, points)
    expected = np.minimum(every.min(1), REACH)
    within = every.min(1) < REACH
    assert 0.3 < within.mean() < 0.99
    closest = meshes.signed_distances(0, points, REACH)
    inside = turns_around(triangles, points) > 0.5
    assert 0.05 < inside.mean() < 0.5
    assert np.abs(np.abs(closest.distances) - expected).max() < 1e-6
    assert np.array_equal(closest.distances < 0, inside)
    assert np.array_equal(closest.faces >= 0, within)
    rows = np.flatnonzero(within)
    assert np.abs(every[rows, closest.faces[rows]] - expected[rows]).max() < 1e-6
    met = np.einsum("pc,pcx->px", closest.weights[rows], triangles[closest.faces[rows]])
    assert np.abs(met - closest.places[rows]).max() < 1e-6
    way = closest.distances[rows, None] * closest.normals[rows]
    assert np.abs(points[rows] - closest.places[rows] - way).max() < 1e-6
    faces, weights = meshes.closest_faces(0, points, REACH)
    assert np.array_equal(faces, closest.faces)
    assert np.array_equal(weights, closest.weights)


def test_beyond_the_reach_is_nothing() -> None:
    mesh = crossing_limbs()
    closest = MovingMeshes(mesh.vertices, [mesh.faces]).signed_distances(0, np.full((1, 3), 2.0), REACH)
    assert closest.faces.tolist() == [-1]
    assert closest.distances.tolist() == [REACH]
    assert closest.places.tolist() == [[2.0] * 3]
    assert not closest.normals.any()
    assert not closest.weights.any()


def test_a_point_on_the_surface_has_the_normal_of_its_face() -> None:
    mesh = trimesh.creation.icosphere(2)
    closest = MovingMeshes(mesh.vertices, [mesh.faces]).signed_distances(0, mesh.triangles_center, REACH)
    assert np.abs(closest.distances).max() < 1e-6
    assert np.abs(closest.normals - mesh.face_normals).max() < 1e-5


def test_rays_through_corners_and_edges_count_once() -> None:
    """From the middle of a box, and from points beside it, ways lead through corners, edges and diagonals."""
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    points = np.stack(np.meshgrid(*[np.linspace(-0.75, 0.75, 7)] * 3), -1).reshape(-1, 3)
    height = np.abs(points).max(1)
    closest = MovingMeshes(box.vertices, [box.faces]).signed_distances(0, points, 2.0)
    off = np.abs(height - 0.5) > 1e-6
    assert np.array_equal(closest.distances[off] < 0, height[off] < 0.5)


def test_the_nearest_mesh_is_the_first_in_depth_and_says_how_much_room_there_is() -> None:
    """Two blocks, 10 mm apart: what is between them, beside them and inside of one."""
    below, above = trimesh.creation.box((0.4, 0.4, 0.1)), trimesh.creation.box((0.4, 0.4, 0.1))
    below.apply_translation([0, 0, -0.055])
    above.apply_translation([0, 0, 0.055])
    both = trimesh.util.concatenate([below, above])
    meshes = MovingMeshes(both.vertices, np.split(both.faces, 2))
    points = np.array([[0, 0, 0.001], [0, 0, -0.02], [0, 0, -0.02], [0, 0, 0.3], [0, 0, 0.0]])
    touches = np.array([3, 3, 2, 3, 0])
    near = meshes.nearest(touches, points, 0.2, ALL, 0.004)
    assert near.distances == pytest.approx([0.004, -0.015, 0.025, 0.195, 0.2], abs=1e-6)
    assert near.gaps == pytest.approx([0.01, 0.01, 10.0, 10.0, 10.0], abs=1e-6)
    assert near.normals[:, 2] == pytest.approx([-1, 1, -1, 1, 0])
    assert near.offsets == pytest.approx([-0.005, -0.005, -0.005, 0.105, 0], abs=1e-6)
    bounded = meshes.nearest(touches, points, 0.2, 0.002, 0.004)
    assert bounded.distances == pytest.approx([0.002, -0.015, 0.002, 0.002, 0.2], abs=1e-6)


def test_depth_in_several_limbs_is_that_of_each_alone() -> None:
    limbs, points = crossing_limbs(), cloud()
    halves = np.split(limbs.faces, 2)
    meshes = MovingMeshes(limbs.vertices, halves)
    corners = limbs.vertices.astype(np.float32).astype(float)
    alone = [
        np.minimum(distances_of(corners[half], points).min(1), REACH)
        * np.where(turns_around(corners[half], points) > 0.5, -1, 1)
        for half in halves
    ]
    deepest = np.minimum(*alone)
    for exact in (0.02, ALL):
        distances = meshes.nearest(np.full(POINTS, 3), points, REACH, exact, 0.004).distances
        known = deepest < exact
        assert known.sum() > 10
        assert np.abs(distances - deepest)[known].max() < 1e-6
        assert (distances[~known] <= deepest[~known] + 1e-6).all()


def test_edges_that_cross_are_those_that_solving_for_every_face_finds() -> None:
    mesh = crossing_limbs()
    draw = np.random.default_rng(2)
    corners = (mesh.vertices + draw.normal(scale=0.03, size=mesh.vertices.shape)).astype(np.float32)
    edges, triangles = mesh.edges_unique, corners.astype(float)[mesh.faces]
    start, end = (corners.astype(float)[edges[:, side]] for side in (0, 1))
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    shape = (len(edges), len(mesh.faces), 3)
    columns = [np.broadcast_to(each, shape) for each in (ab, ac, (start - end)[:, None])]
    way = (start[:, None] - a)[..., None]
    systems = np.stack(columns, -1)
    parallel = np.abs(np.linalg.det(systems)) < 1e-15
    systems[parallel] = np.eye(3)
    u, v, t = np.moveaxis(np.linalg.solve(systems, way)[..., 0], -1, 0)
    shared = (edges[:, None, :, None] == mesh.faces[None, :, None, :]).any((2, 3))
    expected = ((u > 0) & (v > 0) & (u + v < 1) & (t > 0) & (t < 1) & ~shared & ~parallel).any(1)
    crosses = MovingMeshes(corners, [mesh.faces]).crossing_edges(0, edges)
    assert 0.05 < expected.mean() < 0.9
    assert np.array_equal(crosses, expected)


def test_meshes_answer_where_they_have_moved_to() -> None:
    mesh, points = crossing_limbs(), cloud()
    shift = np.array([1.0, 0.5, -2.0])
    moved, there = (MovingMeshes(mesh.vertices + offset, [mesh.faces]) for offset in (0, shift))
    moved.move(mesh.vertices + shift)
    one, other = (each.signed_distances(0, points + shift, REACH) for each in (moved, there))
    assert np.abs(one.distances - other.distances).max() < 1e-6
    assert not (moved.signed_distances(0, points, REACH).faces >= 0).any()


def test_points_that_are_nowhere_have_nothing_near() -> None:
    mesh = crossing_limbs()
    points = np.array([[np.nan, 0, 0], [0, np.inf, 0], [0, 0, -np.inf], [np.nan] * 3])
    for reach in (REACH, np.inf, np.nan):
        meshes = MovingMeshes(mesh.vertices, [mesh.faces])
        assert meshes.signed_distances(0, points, reach).faces.tolist() == [-1] * 4
        assert not meshes.nearest(np.ones(4), points, reach, ALL, 0.0).normals.any()


def test_a_mesh_without_faces_and_faces_without_area_are_met_by_nothing_else() -> None:
    points = cloud(9)
    empty = MovingMeshes(np.zeros((3, 3)), [np.zeros((0, 3), int)] * 2)
    empty.move(np.ones((3, 3)))
    assert (empty.signed_distances(1, points, REACH).faces == -1).all()
    assert (empty.closest_faces(0, points, np.inf)[0] == -1).all()
    assert empty.nearest(np.full(9, 3), points, REACH, ALL, 0.0).distances.tolist() == [REACH] * 9
    assert not empty.crossing_edges(0, np.array([[0, 1], [1, 2]])).any()
    assert not len(empty.closest_faces(0, points[:0], REACH)[0])
    needle = MovingMeshes(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]]), [np.array([[0, 1, 2], [0, 0, 0]])])
    closest = needle.signed_distances(0, np.array([[0.5, 0.1, 0.0]]), REACH)
    assert closest.distances == pytest.approx([0.1])
    assert closest.faces.tolist() == [0]


@pytest.mark.parametrize("corner", [-1, 3])
def test_a_corner_that_is_no_vertex_is_refused(corner: int) -> None:
    with pytest.raises(ValueError, match=f"face 1 has the corner {corner} of 3 vertices"):
        MovingMeshes(np.zeros((3, 3)), [np.array([[0, 1, 2]]), np.array([[0, 1, corner]])])


def test_more_meshes_than_bits_are_refused() -> None:
    with pytest.raises(ValueError, match="32 meshes are more than 31"):
        MovingMeshes(np.zeros((3, 3)), [np.array([[0, 1, 2]])] * 32)


def test_edges_are_evened_as_the_passes_say() -> None:
    """Beside the same passes in float64: a ring of edges, and a vertex with none that a plane holds."""
    draw, count, passes = np.random.default_rng(3), 20, 7
    rest = np.array([[np.cos(t), np.sin(t), 0.0] for t in np.linspace(0, 2 * np.pi, count, endpoint=False)])
    neighbours = np.stack([np.arange(count) - 1, np.arange(count) + 1], 1) % count
    ways = rest[neighbours] - rest[:, None]
    lengths, curvatures = np.linalg.norm(ways, axis=2), np.linalg.norm(ways.mean(1), axis=1)
    start = rest + draw.normal(scale=0.1, size=rest.shape)
    normals = np.tile([0.0, 0.0, 1.0], (count, 1))
    offsets = np.where(np.arange(count) % 3 == 0, 0.02, -1e6)
    now, before, weight = start, start, 1.0
    for turn in range(passes):
        square = 0.995**2
        plain = turn < 2 or turn == passes - 1
        weight = 1.0 if plain else 2 / (2 - square) if turn == 2 else 4 / (4 - square * weight)
        edges = now[neighbours] - now[:, None]
        size = np.linalg.norm(edges, axis=2)
        pull = ((1 - lengths / size)[..., None] * edges).mean(1)
        curve = edges.mean(1)
        excess = np.maximum(1 - curvatures / np.linalg.norm(curve, axis=1), 0)
        place = now + 0.9 * pull + 0.04 * excess[:, None] * curve
        place = before + weight * (place - before)
        place += np.maximum(offsets - (normals * place).sum(1), 0)[:, None] * normals
        now, before = place, now
    lonely = np.array([[0.5, 0.5, -1.0]])
    starts = np.append(2 * np.arange(count + 1), 2 * count)
    graph = SurfaceGraph(starts, neighbours.reshape(-1), lengths.reshape(-1))
    evened = graph.even_edges(
        np.concatenate([start, lonely]),
        np.append(curvatures, 0.0),
        np.concatenate([normals, [[0, 0, 1.0]]]),
        np.append(offsets, -0.25),
        passes,
    )
    assert np.abs(evened[:-1] - now).max() < 1e-5
    assert evened[-1] == pytest.approx([0.5, 0.5, -0.25])
