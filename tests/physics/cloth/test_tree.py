"""What the trees find, against searches of all pairs."""

import math
from itertools import combinations

import numpy as np
import pytest
import torch
import trimesh
from numpy.typing import NDArray
from torch import Tensor

from tests.physics.cloth.stepping import solver, still_frames
from tests.simulate.physics.scenes import disc, sheet
from uvcloth.geometry.mesh import join_meshes
from uvcloth.physics.cloth.body_contact import CLOSE, Contacts, Watch, find_contacts
from uvcloth.physics.cloth.cloth import Sheet, make_cloth
from uvcloth.physics.cloth.moving_body import Body, Passage, begin_passage, end_passage, make_body, no_memory
from uvcloth.physics.cloth.self_contact import Pairs, find_pairs, no_pairs
from uvcloth.physics.cloth.solver import start
from uvcloth.physics.cloth.tree import APART, DONE, Tree, adjacent_nodes
from uvcloth.physics.fabric import Fabric

MARGIN = 0.006
ROUNDING = 1e-6


@pytest.mark.parametrize("guessed", [False, True])
@pytest.mark.parametrize("reach", [0.05, 0.5])
def test_the_closest_face_is_that_of_a_search_of_all_faces(reach: float, guessed: bool) -> None:
    """On a ball with bumps and a box; hints are those of other vertices, so that they may not matter."""
    surface, parts, points, draw = bumps_and_box()
    body = make_body(surface, parts, np.ones((2, len(points)), bool))
    hints = np.stack([draw.integers(0, len(parts[0]), 500), np.full(500, -1)]).astype(np.int32)
    known = no_memory(body)
    before = known._replace(faces=hints) if guessed else known
    passage = begin_passage(body, surface, surface, points, before, 0, 1)
    found = contacts_of(body, passage, np.float32(0.0), points, np.float32(reach))
    for part, faces in enumerate(parts):
        mesh = trimesh.Trimesh(surface, faces, process=False)
        _, expected, _ = trimesh.proximity.closest_point_naive(mesh, points)
        rows = np.nonzero((found.faces >= len(parts[0])) == (part == 1))[0]
        vertices, chosen = found.vertices[rows], body.faces[found.faces[rows]]
        np.testing.assert_array_equal(vertices, np.nonzero(expected < reach)[0])
        corners = surface.astype(np.float64)[chosen]
        np.testing.assert_allclose(
            distances_from(corners, points[vertices]), expected[vertices], atol=ROUNDING
        )


def contacts_of(
    body: Body, passage: Passage, share: np.float32, points: NDArray[np.float32], reach: np.float32
) -> Contacts:
    """Contacts of points (N, 3) that touch a body from its reach on."""
    near, still = np.full(len(points), reach), np.zeros_like(points)
    watch = Watch(still, near, np.float32(0.0), np.float32(1.0), reach, CLOSE)
    return find_contacts(body, passage, share, points, watch)


def bumps_and_box(
    bumps: float = 0.01,
) -> tuple[NDArray[np.float32], list[NDArray], NDArray[np.float32], np.random.Generator]:
    """Vertices (V, 3) of a ball with bumps and a box, the faces of each, 500 points around them, and dice."""
    draw = np.random.default_rng(0)
    ball, box = trimesh.creation.icosphere(3, radius=0.2), trimesh.creation.box([0.3, 0.1, 0.2])
    ball.vertices += bumps * draw.normal(size=ball.vertices.shape)
    surface = np.concatenate([ball.vertices, box.vertices + np.array([0.1, 0.0, 0.0])]).astype(np.float32)
    points = draw.uniform(-0.5, 0.5, (500, 3)).astype(np.float32)
    return surface, [np.array(ball.faces), box.faces + len(ball.vertices)], points, draw


def test_searches_that_know_of_those_before_find_what_the_first_would() -> None:
    """The body turns and grows and the points drift, in five frames with ten searches and one without others.

    On convex parts a point that is followed outside of them ends at a closest face.
    """
    surface, parts, points, draw = bumps_and_box(bumps=0.0)
    speeds = draw.normal(size=points.shape).astype(np.float32)
    body = make_body(surface, parts, np.ones((2, len(points)), bool))
    turn = trimesh.transformations.rotation_matrix(0.1, [0.3, 1.0, -0.2])[:3, :3]
    known, none, reach = no_memory(body), no_memory(body), np.float32(0.05)
    skipped = followed = 0
    for frame in range(5):
        end = (1.04 * surface @ turn.T + [0.01, -0.02, 0.0]).astype(np.float32)
        together = begin_passage(body, surface, end, points, known, frame, 4)
        for share in np.linspace(0.1, 1.0, 10, dtype=np.float32):
            now = points + 0.01 * share * speeds
            skipped += int((together.clear > 0.1).sum())
            followed += int((together.hints >= 0).sum())
            found = contacts_of(body, together, share, now, reach)
            alone = begin_passage(body, surface, end, now, none, 0, 1)
            again = contacts_of(body, alone, share, now, reach)
            shape = (1.0 - share) * surface + share * end
            for part in range(2):
                rows, expected = (
                    np.nonzero((each.faces >= len(parts[0])) == (part == 1))[0] for each in (found, again)
                )
                outside = ~trimesh.Trimesh(shape, parts[part], process=False).contains(now)
                rows = rows[outside[found.vertices[rows]]]
                expected = expected[outside[again.vertices[expected]]]
                np.testing.assert_array_equal(found.vertices[rows], again.vertices[expected])
                ways = (
                    distances_from(shape[body.faces[each.faces[which]]], now[each.vertices[which]])
                    for each, which in ((found, rows), (again, expected))
                )
                np.testing.assert_allclose(next(ways), next(ways), atol=ROUNDING)
        known = end_passage(together, now)
        surface, points = end, now
    assert skipped > 5000
    assert followed > 1000


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
    made = make_cloth(rest.numpy(), faces.numpy(), Fabric()).sheet
    still = np.zeros(points.shape, np.float32)
    found = found_pairs(made, points.numpy(), still)
    for near, (pairs, distances) in zip(found, all_pairs(made, points.numpy()), strict=True):
        sure, possible = (keys(pairs[distances < MARGIN + by]) for by in (-ROUNDING, ROUNDING))
        assert len(sure) > 100
        assert sure <= near <= possible


def test_pairs_are_found_that_only_come_near_before_the_next_search() -> None:
    """One of two layers, 4 mm and more apart, comes down by 2 cm in the interval and turns."""
    rest, points, faces = two_layers()
    made = make_cloth(rest.numpy(), faces.numpy(), Fabric()).sheet
    upper = (rest[:, 2] == 0.0) & (torch.arange(len(rest)) >= len(disc(0.1, 9)[0]))
    speeds = torch.where(upper[:, None], torch.tensor([0.5, 0.0, -2.0]), 0.0)
    speeds[:, 0] += torch.where(upper, 5.0 * rest[:, 1], 0.0)
    points[upper, 2] += 0.01
    start, velocities = points.numpy(), speeds.numpy()
    found = found_pairs(made, start, velocities, 0.01)
    assert not any(keys(pairs[distances < MARGIN]) for pairs, distances in all_pairs(made, start))
    for share in (0.3, 0.6, 1.0):
        moved = start + np.float32(0.01 * share) * velocities
        for near, (pairs, distances) in zip(found, all_pairs(made, moved), strict=True):
            assert keys(pairs[distances < MARGIN - ROUNDING]) <= near


def test_garments_that_never_meet_are_not_searched_for_each_other() -> None:
    rest, points, faces = two_layers()
    below = len(disc(0.1, 9)[1])
    garment_of = (np.arange(len(faces)) >= below).astype(int)
    for apart in (np.zeros((2, 2), np.bool_), ~np.eye(2, dtype=np.bool_)):
        sheet = make_cloth(
            rest.numpy(), faces.numpy(), [Fabric()] * 2, fabric_of=garment_of, apart=apart
        ).sheet
        near, _ = found_pairs(sheet, points.numpy(), np.zeros(points.shape, np.float32))
        lower = {int(vertex) for vertex in faces[:below].unique()}
        between = {pair for pair in near if (pair[0] in lower) != (int(sheet.faces[pair[1], 0]) in lower)}
        assert bool(between) != apart.any()


def found_pairs(sheet: Sheet, points: NDArray, speeds: NDArray, seconds: float = 0.0) -> tuple[set, set]:
    """Keys of vertices with faces, and of edges with edges, that the trees find."""
    nodes = len(sheet.tree.ranges)
    boxes, moving, cones = (np.empty((nodes, size), np.float32) for size in (6, 6, 5))
    pairs: Pairs = find_pairs(
        sheet, points, speeds, np.float32(MARGIN), np.float32(seconds), no_pairs(), boxes, moving, cones
    )
    assert len(keys(pairs.points)) == len(pairs.points)
    assert len(keys(np.sort(pairs.edges, 1))) == len(pairs.edges)
    return keys(pairs.points), keys(np.sort(pairs.edges, 1))


def keys(pairs: NDArray) -> set[tuple[int, int]]:
    return {(first, second) for first, second in pairs.tolist()}


def all_pairs(sheet: Sheet, points: NDArray) -> list[tuple[NDArray, NDArray]]:
    """All vertices with faces, and all edges with edges, that share no ring, and their distances."""
    points = points.astype(np.float64)
    near = np.eye(len(points), dtype=bool)
    near[sheet.edges[:, 0], sheet.edges[:, 1]] = near[sheet.edges[:, 1], sheet.edges[:, 0]] = True
    vertex, face = np.nonzero(~near[:, sheet.faces].any(2))
    closest = trimesh.triangles.closest_point(points[sheet.faces[face]], points[vertex])
    first, second = np.triu_indices(len(sheet.edges), 1)
    a, b = sheet.edges[first], sheet.edges[second]
    apart = ~near[a[:, :, None], b[:, None, :]].any((1, 2))
    a, b, first, second = a[apart], b[apart], first[apart], second[apart]
    return [
        (np.stack([vertex, face], 1), np.linalg.norm(points[vertex] - closest, axis=1)),
        (np.stack([first, second], 1), segment_distances(points[a], points[b])),
    ]


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


@pytest.mark.parametrize("name", CLOTHS)
def test_adjacent_nodes_are_those_a_walk_meets_whose_faces_share_a_vertex(name: str) -> None:
    rest, _, faces = CLOTHS[name]()
    made = make_cloth(rest.numpy(), faces.numpy(), Fabric()).sheet
    tree, expected = made.tree, []
    corners = [set(made.faces[tree.order[start:end]].ravel().tolist()) for start, end in tree.ranges]
    keys = adjacent_nodes(tree, made.faces)
    waiting = [(root, root, APART) for root in tree.roots]
    waiting += [(*pair, APART) for pair in combinations(tree.roots, 2)]
    while waiting:
        a, b, number = waiting.pop()
        if a != b:
            assert (number == APART) == (not corners[a] & corners[b])
            if number == APART:
                continue
            key = int(a) * len(tree.ranges) + int(b)
            expected.append(key)
            assert number == DONE or keys[number] == key
        numbers = (APART, APART, made.halves[a]) if a == b else made.following[number]
        following = walked(tree, a, b)
        assert following or a == b or number == DONE
        waiting.extend((*pair, each) for pair, each in zip(following, numbers, strict=False))
    assert keys.tolist() == sorted(expected)


def walked(tree: Tree, a: int, b: int) -> list[tuple[int, int]]:
    """The pairs after a pair in a walk: children of the node of more faces, of the first of two alike."""
    (left, right), (other, another) = tree.children[a], tree.children[b]
    if a == b:
        return [] if left < 0 else [(left, left), (right, right), (left, right)]
    sizes = tree.ranges[:, 1] - tree.ranges[:, 0]
    if left < 0 and other < 0:
        return []
    if other < 0 or (left >= 0 and sizes[a] >= sizes[b]):
        return [(left, b), (right, b)]
    return [(a, other), (a, another)]
