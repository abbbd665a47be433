"""What searches of the runtime find, against searches of all pairs."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from numpy.typing import NDArray
from torch import Tensor

from tests.physics.cloth.stepping import INSTANT, pairs_near, solver, still_frames
from tests.simulation.physics.scenes import disc, sheet
from tests.thorough import always
from uvcloth.geometry.mesh import join_meshes
from uvcloth.physics.cloth.body import make_body
from uvcloth.physics.cloth.cloth import Cloth, make_cloth
from uvcloth.physics.cloth.solver import Motion, Settings, Solver, make_solver, start, step
from uvcloth.physics.fabric import Fabric
from uvcloth.player.cloth import nothing_searched

MARGIN = 0.006
ROUNDING = 1e-6

WATCHED = 0.004
"""Metres more than where cloth touches the body within which a closest face is kept."""


@pytest.fixture(scope="module")
def true_distances() -> list[NDArray[np.float64]]:
    """Distance (N,) of each point from each part of `bumps_and_box`, by a search of all faces."""
    surface, parts, points, _ = bumps_and_box()
    meshes = [trimesh.Trimesh(surface, triangles, process=False) for triangles in parts]
    return [trimesh.proximity.closest_point_naive(mesh, points)[1] for mesh in meshes]


@pytest.mark.parametrize(
    ("reach", "guessed"), always([(0.5, True)], [(0.05, False), (0.05, True), (0.5, False), (0.5, True)])
)
def test_the_closest_face_is_that_of_a_search_of_all_faces(
    reach: float, guessed: bool, true_distances: list[NDArray[np.float64]]
) -> None:
    """On a ball with bumps and a box; hints are those of other vertices, so that they may not matter."""
    surface, parts, points, draw = bumps_and_box()
    made = loose(surface, parts, points, Settings(radius=reach - WATCHED, reach=reach, self_contact=False))
    state = start(made, points)
    if guessed:
        hints = np.stack([draw.integers(0, len(parts[0]), len(points)), np.full(len(points), -1)])
        state = replace(state, near=replace(state.near, faces=hints.astype(np.int32)))
    found = step(made, state, still(made, points, surface, surface, INSTANT)).near.faces
    faces = np.concatenate(parts)
    for part, expected in enumerate(true_distances):
        rows = np.nonzero(found[part] >= 0)[0]
        assert ((found[part, rows] >= len(parts[0])) == (part == 1)).all()
        np.testing.assert_array_equal(rows, np.nonzero(expected < reach)[0])
        distances = distances_from(surface[faces[found[part, rows]]], points[rows])
        np.testing.assert_allclose(distances, expected[rows], atol=ROUNDING)


def test_searches_that_know_of_those_before_find_what_the_first_would() -> None:
    """The body turns, grows and pushes points, in five frames of ten searches that follow or begin anew.

    On convex parts a point that is followed outside of them ends at a closest face.
    """
    surface, parts, points, _ = bumps_and_box(bumps=0.0)
    inside = [trimesh.Trimesh(surface, part, process=False).contains(points) for part in parts]
    points = points[~np.logical_or(*inside)]
    points = points[: len(points) // 3 * 3]
    reach, seconds = 0.05, 1.0 / 30.0
    settings = Settings(
        radius=reach - WATCHED,
        reach=reach,
        self_contact=False,
        renewal=4,
        substeps=600,
        interval=seconds / 10,
    )
    made = loose(surface, parts, points, settings)
    turn = trimesh.transformations.rotation_matrix(0.1, [0.3, 1.0, -0.2])[:3, :3]
    faces, state, changed = np.concatenate(parts), start(made, points), 0
    for _ in range(5):
        end = 1.04 * surface @ turn.T + [0.01, -0.02, 0.0]
        motion = still(made, points, surface, end, seconds)
        anew = step(made, replace(state, near=nothing_searched(2, len(points)), frame=0), motion)
        before, state = state, step(made, state, motion)
        changed += int(((before.near.faces != state.near.faces) & (before.near.faces >= 0)).sum())
        np.testing.assert_allclose(state.vertices(), anew.vertices(), atol=1e-5)
        both = (state.near.faces >= 0) & (anew.near.faces >= 0)
        assert both.sum() > 0.98 * (anew.near.faces >= 0).sum() > 100
        for part in range(2):
            rows = np.nonzero(both[part])[0]
            ways = [
                distances_from(end[faces[each.near.faces[part, rows]]], each.vertices()[rows])
                for each in (state, anew)
            ]
            np.testing.assert_allclose(*ways, atol=2e-5)
        surface = end
    assert changed > 100


def loose(surface: NDArray, parts: list[NDArray], points: NDArray, settings: Settings) -> Solver:
    """Points that almost nothing holds together: corners of limp faces, among the parts of a body."""
    faces = np.arange(len(points)).reshape(-1, 3)
    limp = Fabric(stretch=1e-6, bend=0.0, drag=0.0, friction=0.0)
    body = make_body(surface, parts, np.ones((len(parts), len(points)), bool))
    return make_solver(make_cloth(points, faces, limp), points, body, settings)


def still(made: Solver, points: NDArray, start: NDArray, end: NDArray, seconds: float) -> Motion:
    """A frame without weight in which the body alone moves."""
    nothing, up = np.zeros(len(points), np.float32), np.zeros(points.shape, np.float32)
    up[:, 2] = 9.81 * made.cloth.particles.weight
    return Motion(seconds, start, end, points, points, nothing, nothing, up)


def bumps_and_box(
    bumps: float = 0.01,
) -> tuple[NDArray[np.float64], list[NDArray], NDArray[np.float64], np.random.Generator]:
    """Vertices (V, 3) of a ball with bumps and a box, the faces of each, 2001 points, and dice."""
    draw = np.random.default_rng(0)
    ball, box = trimesh.creation.icosphere(3, radius=0.2), trimesh.creation.box([0.3, 0.1, 0.2])
    ball.vertices += bumps * draw.normal(size=ball.vertices.shape)
    surface = np.concatenate([ball.vertices, box.vertices + np.array([0.1, 0.0, 0.0])])
    points = draw.uniform(-0.4, 0.4, (2001, 3))
    return surface, [np.array(ball.faces), box.faces + len(ball.vertices)], points, draw


def distances_from(corners: NDArray, points: NDArray) -> NDArray:
    """Distance (N,) of each point from its triangle (N, 3, 3)."""
    return np.asarray(np.linalg.norm(trimesh.triangles.closest_point(corners, points) - points, axis=1))


def pleated() -> tuple[Tensor, Tensor, Tensor]:
    """A sheet, and the same laid in four layers 4 mm apart and twisted, with bumps of a millimetre."""
    rest, faces = sheet(0.4, 0.1, 33, 9)
    turn, radius = math.pi * 0.002, 0.002
    leg = 0.1 - turn
    way = rest[:, 0]
    layer, along = (way / 0.1).floor().clamp(max=3), way - 0.1 * (way / 0.1).floor().clamp(max=3)
    angle = ((along - leg) / radius).clamp(min=0.0)
    x = torch.where(along < leg, along, leg + radius * angle.sin())
    z = 2.0 * radius * layer + radius * (1.0 - angle.cos())
    x = torch.where(layer % 2 == 0, x, leg - x)
    bumps = 0.0005 * torch.randn(rest.shape, generator=torch.manual_seed(0))
    return rest, torch.stack([x, rest[:, 1], z + 0.1 * x * rest[:, 1]], 1) + bumps, faces


def crumpled() -> tuple[Tensor, Tensor, Tensor]:
    """A sheet, and how it lies where it fell on its edge onto a floor and through itself."""
    rest, faces = sheet(0.3, 0.2, 25, 17)
    draw = torch.manual_seed(1)
    upright = torch.stack([0.002 * torch.randn(len(rest), generator=draw), rest[:, 1], 0.01 + rest[:, 0]], 1)
    floor = trimesh.creation.box(
        [1.0, 1.0, 0.2], trimesh.transformations.translation_matrix([0.0, 0.0, -0.1])
    )
    made = solver(rest, faces, things=[floor], self_contact=False)
    end = still_frames(made, start(made, upright.numpy()), upright, 0.4, things=[floor])[-1]
    return rest, torch.from_numpy(end.vertices()).float(), faces


def two_layers() -> tuple[Tensor, Tensor, Tensor]:
    """Two bowls that lie 4 mm apart, of different meshes."""
    first, second = disc(0.1, 9), sheet(0.2, 0.2, 12, 12)
    below, above = first[0], second[0] - torch.tensor([0.1, 0.1, 0.0])
    joined = join_meshes([(below, first[1]), (above, second[1])])
    lift = 4.0 * joined.vertices[:, :2].square().sum(1)
    lift[len(below) :] += 0.004
    return joined.vertices, joined.vertices + lift[:, None] * torch.tensor([0.0, 0.0, 1.0]), joined.faces


CLOTHS = {"pleated": pleated, "crumpled": crumpled, "two layers": two_layers}


@pytest.mark.parametrize("name", CLOTHS)
def test_all_pairs_of_cloth_near_cloth_are_found_and_no_others(name: str) -> None:
    rest, points, faces = CLOTHS[name]()
    made = make_cloth(rest.numpy(), faces.numpy(), Fabric())
    found = found_pairs(made, points.numpy())
    for near, (pairs, distances, beside) in zip(found, all_pairs(made, points.numpy()), strict=True):
        sure = keys(pairs[(distances < MARGIN - ROUNDING) & ~beside])
        assert len(sure) > 100
        assert sure <= near <= keys(pairs[distances < MARGIN + ROUNDING])


def test_neighbours_in_a_sharp_fold_are_found() -> None:
    """A sheet with edges of 2 cm lies on itself, folded along a row of edges."""
    rest, faces = sheet(0.08, 0.08, 5, 5)
    made = make_cloth(rest.numpy(), faces.numpy(), Fabric())
    beyond = (rest[:, :1] - 0.04).clamp(min=0.0)
    slope = torch.tensor([0.1])
    points = rest - beyond * torch.cat([1.0 + slope.cos(), 0.0 * slope, -slope.sin()])
    found = found_pairs(made, points.numpy())
    for near, (pairs, distances, beside) in zip(found, all_pairs(made, points.numpy()), strict=True):
        assert len(near & keys(pairs[beside])) > 5
        assert keys(pairs[beside & (distances < MARGIN - ROUNDING)]) <= near
    assert not any(found_pairs(made, rest.numpy()))


def test_pairs_are_found_that_only_come_near_before_the_next_search() -> None:
    """One of two layers, 4 mm and more apart, comes down by 2 cm in the interval and turns."""
    rest, points, faces = two_layers()
    made = make_cloth(rest.numpy(), faces.numpy(), Fabric())
    upper = (rest[:, 2] == 0.0) & (torch.arange(len(rest)) >= len(disc(0.1, 9)[0]))
    speeds = torch.where(upper[:, None], torch.tensor([0.5, 0.0, -2.0]), 0.0)
    speeds[:, 0] += torch.where(upper, 5.0 * rest[:, 1], 0.0)
    points[upper, 2] += 0.01
    start, velocities = points.numpy(), speeds.numpy()
    found = found_pairs(made, start, velocities, 0.01)
    assert not any(keys(pairs[distances < MARGIN]) for pairs, distances, _ in all_pairs(made, start))
    for share in (0.5, 1.0):
        moved = start + np.float32(0.01 * share) * velocities
        for near, (pairs, distances, beside) in zip(found, all_pairs(made, moved), strict=True):
            assert keys(pairs[(distances < MARGIN - ROUNDING) & ~beside]) <= near


def test_garments_that_never_meet_are_not_searched_for_each_other() -> None:
    rest, points, faces = two_layers()
    below = len(disc(0.1, 9)[1])
    garment_of = (np.arange(len(faces)) >= below).astype(int)
    for apart in (np.zeros((2, 2), np.bool_), ~np.eye(2, dtype=np.bool_)):
        made = make_cloth(rest.numpy(), faces.numpy(), [Fabric()] * 2, fabric_of=garment_of, apart=apart)
        near, _ = found_pairs(made, points.numpy())
        lower = {int(vertex) for vertex in faces[:below].unique()}
        between = {
            pair for pair in near if (pair[0] in lower) != (int(made.sheet.faces[pair[1], 0]) in lower)
        }
        assert bool(between) != apart.any()


def found_pairs(
    cloth: Cloth, points: NDArray, speeds: NDArray | None = None, seconds: float = INSTANT
) -> tuple[set, set]:
    """Keys of vertices with faces, and of edges with edges, that the runtime finds."""
    pairs = pairs_near(cloth, points, MARGIN, speeds, seconds)
    assert len(keys(pairs.points)) == len(pairs.points)
    assert len(keys(np.sort(pairs.edges, 1))) == len(pairs.edges)
    return keys(pairs.points), keys(np.sort(pairs.edges, 1))


def keys(pairs: NDArray) -> set[tuple[int, int]]:
    return {(first, second) for first, second in pairs.tolist()}


def all_pairs(cloth: Cloth, points: NDArray) -> list[tuple[NDArray, NDArray, NDArray]]:
    """All vertices with faces, and all edges with edges, that share no vertex, but neighbours only where they
    are apart at rest; their distances, and whether they are neighbours.
    """
    sheet, rest, points = cloth.sheet, cloth.rest.astype(np.float64), points.astype(np.float64)
    same = np.eye(len(points), dtype=bool)
    ring = same.copy()
    ring[sheet.edges[:, 0], sheet.edges[:, 1]] = ring[sheet.edges[:, 1], sheet.edges[:, 0]] = True
    vertex, face = np.nonzero(~same[:, sheet.faces].any(2))
    first, second = np.triu_indices(len(sheet.edges), 1)
    a, b = sheet.edges[first], sheet.edges[second]
    apart = ~same[a[:, :, None], b[:, None, :]].any((1, 2))
    a, b, first, second = a[apart], b[apart], first[apart], second[apart]

    def distances(places: NDArray) -> tuple[NDArray, NDArray]:
        closest = trimesh.triangles.closest_point(places[sheet.faces[face]], places[vertex])
        return np.linalg.norm(places[vertex] - closest, axis=1), segment_distances(places[a], places[b])

    beside = ring[vertex[:, None], sheet.faces[face]].any(1), ring[a[:, :, None], b[:, None, :]].any((1, 2))
    pairs = np.stack([vertex, face], 1), np.stack([first, second], 1)
    kept = [~near | (gap >= MARGIN) for near, gap in zip(beside, distances(rest), strict=True)]
    columns = zip(pairs, distances(points), beside, kept, strict=True)
    return [(two[chosen], gap[chosen], near[chosen]) for two, gap, near, chosen in columns]


def segment_distances(first: NDArray, second: NDArray) -> NDArray[np.float64]:
    """Distances (K,) of segments (K, 2, 3): that of their lines where both are met within, or of an end."""
    (a, b), (c, d) = np.moveaxis(first, 1, 0), np.moveaxis(second, 1, 0)
    normal = np.cross(b - a, d - c)
    squared = (normal**2).sum(1)
    shares = [
        (np.cross(c - a, along) * normal).sum(1) / np.maximum(squared, 1e-30) for along in (d - c, b - a)
    ]
    within = (squared > 1e-16) & np.logical_and.reduce([(share >= 0.0) & (share <= 1.0) for share in shares])
    lines = np.abs(((c - a) * normal).sum(1)) / np.sqrt(np.maximum(squared, 1e-30))
    ends = [point_distances(p, q, r) for p, q, r in ((a, c, d), (b, c, d), (c, a, b), (d, a, b))]
    return np.minimum(np.where(within, lines, np.inf), np.minimum.reduce(ends))


def point_distances(point: NDArray, start: NDArray, end: NDArray) -> NDArray[np.float64]:
    along = end - start
    share = (((point - start) * along).sum(1) / (along**2).sum(1)).clip(0.0, 1.0)
    return np.linalg.norm(start + share[:, None] * along - point, axis=1)
