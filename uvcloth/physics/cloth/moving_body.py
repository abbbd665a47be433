"""A moving body that cloth collides with: its parts, their way through a frame, and search results."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uvcloth.physics.cloth.tree import (
    BODY_LEAF,
    Patches,
    Tree,
    build_tree,
    find_patches,
    join_boxes,
    neighbour_faces,
)
from uvcloth.physics.cloth.triangles import closest_barycentrics, weighted
from uvcloth.physics.cloth.vectors import (
    ONE,
    TINY,
    ZERO,
    Array,
    Number,
    Vector,
    add,
    angle,
    combine,
    cross,
    dot,
    length,
    load,
    scale,
    store,
    sub,
    unit,
)
from uvcloth.process.compiled import borrowing, compiled, inlined

PATCH = 64
"""Faces in a patch of a body at most, whose boxes are fitted where cloth is near."""

ROUNDED = np.float32(1e-5)
"""Metres by which distances may be off by rounding."""


class Body(NamedTuple):
    """Parts of a body that cloth collides with, each a closed surface, all over the same V vertices.

    faces: (F, 3) int32, part after part. neighbours: (F, 3) int32, across edge i to i + 1. tree: one root per
    part. patches: of the tree; patch_parts: (P,) int32, which part each is of. around: the faces around each
    vertex, in order, from around_starts, (V + 1,), on. touches: (K, N) bool, the parts that may touch each
    vertex of the cloth; crossed: (K, N) bool, those that it may be inside of without a touch.
    """

    faces: NDArray[np.int32]
    neighbours: NDArray[np.int32]
    tree: Tree
    patches: Patches
    patch_parts: NDArray[np.int32]
    around: NDArray[np.int32]
    around_starts: NDArray[np.int32]
    touches: NDArray[np.bool_]
    crossed: NDArray[np.bool_]


def make_body(
    vertices: NDArray, parts: Sequence[NDArray], touches: NDArray, crossed: NDArray | None = None
) -> Body:
    """Make the body of its parts, faces (F, 3) each, at vertices (V, 3) m. touches, crossed: (K, N) bool."""
    faces = np.concatenate([np.zeros((0, 3)), *parts]).astype(np.int32)
    neighbours, first = [np.zeros((0, 3))], 0
    for part in parts:
        adjacent = neighbour_faces(np.asarray(part))
        neighbours.append(np.where(adjacent < 0, -1, adjacent + first))
        first += len(part)
    tree = build_tree(np.asarray(vertices, np.float32), faces, [len(part) for part in parts], BODY_LEAF)
    patches = find_patches(tree, faces, PATCH)
    corners = np.argsort(faces.ravel(), kind="stable")
    return Body(
        faces=faces,
        neighbours=np.concatenate(neighbours).astype(np.int32),
        tree=tree,
        patches=patches,
        patch_parts=(np.searchsorted(tree.roots, patches.roots, side="right") - 1).astype(np.int32),
        around=(corners // 3).astype(np.int32),
        around_starts=np.searchsorted(faces.ravel()[corners], np.arange(len(vertices) + 1)).astype(np.int32),
        touches=np.ascontiguousarray(touches, np.bool_),
        crossed=np.ascontiguousarray(np.zeros_like(touches) if crossed is None else crossed, np.bool_),
    )


class Memory(NamedTuple):
    """Search results of a frame that the next starts from, for each of K parts and N vertices of cloth.

    faces: (K, N) int32, the closest face, -1 for none. clear: (K, N) m, distance without any face.
    """

    faces: NDArray[np.int32]
    clear: NDArray[np.float32]


@compiled
def no_memory(body: Body) -> Memory:
    """Memory before the first search."""
    return Memory(np.full(body.touches.shape, -1, np.int32), np.zeros(body.touches.shape, np.float32))


class Passage(NamedTuple):
    """The body on its way through a frame, and the results of its searches.

    start, end: (V, 3) m before and after the frame. points: (V, 3) m at the last search. normals: (V, 3)
    there, of the vertices for which `known`, (V,) int32, is the number of that search. boxes: (T, 6) of the
    tree, in patches for which `fitted`, (P,) int32, is that number too. hints: (K, N) int32, the face of each
    part at the last search for each vertex of the cloth, -1 for none. before: results of the frame before.
    clear: (K, N) m, distance without any face. searched: (K, N) share of the way at the last search of all
    faces. drifts: (K, 3) m that a part moves in the frame on average;
    ways: (K,) m by which a vertex of it differs from that at most. cloth: (N, 3) m at the last search. share:
    (1,) of the way at which it was. searches: (1,) int32, their number so far. turn, renewal: as
    `begin_passage` says.
    """

    start: NDArray[np.float32]
    end: NDArray[np.float32]
    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    known: NDArray[np.int32]
    boxes: NDArray[np.float32]
    fitted: NDArray[np.int32]
    hints: NDArray[np.int32]
    before: Memory
    clear: NDArray[np.float32]
    searched: NDArray[np.float32]
    drifts: NDArray[np.float32]
    ways: NDArray[np.float32]
    cloth: NDArray[np.float32]
    share: NDArray[np.float32]
    searches: NDArray[np.int32]
    turn: int
    renewal: int


@compiled
def begin_passage(
    body: Body, start: Array, end: Array, positions: Array, before: Memory, turn: int, renewal: int
) -> Passage:
    """Begin a frame of a body at (V, 3) m before and after it, and of cloth at (N, 3) m.

    before: results of the frame before. turn: number of the frame. renewal: frames from one search of the
    whole body for a vertex to the next; with 1, earlier results change only the cost.
    """
    drifts, ways = _ways(body, start, end)
    return Passage(
        start,
        end,
        np.empty_like(start),
        np.empty_like(start),
        np.zeros(len(start), np.int32),
        np.empty((len(body.tree.ranges), 6), np.float32),
        np.zeros(len(body.patches.roots), np.int32),
        np.full(body.touches.shape, -1, np.int32),
        before,
        before.clear.copy(),
        np.zeros(body.touches.shape, np.float32),
        drifts,
        ways,
        positions.copy(),
        np.zeros(1, np.float32),
        np.zeros(1, np.int32),
        turn,
        renewal,
    )


@compiled
def _ways(body: Body, start: Array, end: Array) -> tuple[Array, Array]:
    """Mean way (K, 3) m of the vertices of each part, and (K,) m by which one differs from it at most."""
    patches, parts = body.patches, len(body.touches)
    drifts, ways = np.zeros((parts, 3), np.float32), np.zeros(parts, np.float32)
    counts = np.zeros(parts, np.float32)
    for patch in range(len(patches.roots)):
        total, first = (ZERO, ZERO, ZERO), patches.vertex_starts[patch]
        for k in range(first, patches.vertex_starts[patch + 1]):
            total = add(total, sub(load(end, patches.vertices[k]), load(start, patches.vertices[k])))
        part = body.patch_parts[patch]
        counts[part] += np.float32(patches.vertex_starts[patch + 1] - first)
        store(drifts, part, add(load(drifts, part), total))
    for part in range(parts):
        store(drifts, part, scale(ONE / max(counts[part], ONE), load(drifts, part)))
    for patch in range(len(patches.roots)):
        part, most = body.patch_parts[patch], ZERO
        drift = load(drifts, part)
        for k in range(patches.vertex_starts[patch], patches.vertex_starts[patch + 1]):
            way = sub(load(end, patches.vertices[k]), load(start, patches.vertices[k]))
            most = max(most, dot(sub(way, drift), sub(way, drift)))
        ways[part] = max(ways[part], math.sqrt(most))
    return drifts, ways


@compiled
def end_passage(passage: Passage, positions: Array) -> Memory:
    """Memory at the end of the frame, with cloth at (N, 3) m."""
    clear, left = passage.clear.copy(), ONE - passage.share[0]
    for vertex in range(len(positions)):
        way = sub(load(positions, vertex), load(passage.cloth, vertex))
        for part in range(len(clear)):
            clear[part, vertex] -= approach(passage, part, way, left)
    return Memory(passage.hints, clear)


@inlined
def approach(passage: Passage, part: int, way: Vector, share: Number) -> Number:
    """Metres by which cloth and a part of the body approach in a share of the frame at most."""
    along = combine(ONE, way, -share, load(passage.drifts, part))
    return length(along) + share * passage.ways[part] + ROUNDED


@inlined
def closing(passage: Passage, part: int, velocity: Vector, seconds: Number) -> Number:
    """Metres a frame by which cloth with a velocity, m/s, and a part of the body approach at most."""
    return length(sub(scale(seconds, velocity), load(passage.drifts, part))) + passage.ways[part]


@borrowing
def fit_patches(body: Body, points: Array, boxes: Array) -> None:
    """Fit the boxes of the roots of all patches, and of all nodes above, to points (V, 3)."""
    patches = body.patches
    for patch in range(len(patches.roots)):
        node = patches.roots[patch]
        first = load(points, patches.vertices[patches.vertex_starts[patch]])
        x_low, y_low, z_low = x_high, y_high, z_high = first
        for k in range(patches.vertex_starts[patch] + 1, patches.vertex_starts[patch + 1]):
            x, y, z = load(points, patches.vertices[k])
            x_low, y_low, z_low = min(x_low, x), min(y_low, y), min(z_low, z)
            x_high, y_high, z_high = max(x_high, x), max(y_high, y), max(z_high, z)
        store(boxes, node, (x_low, y_low, z_low))
        boxes[node, 3], boxes[node, 4], boxes[node, 5] = x_high, y_high, z_high
    for node in patches.above:
        join_boxes(boxes, node, body.tree.children[node, 0], body.tree.children[node, 1])


@inlined
def find_normals(body: Body, passage: Passage, face: int) -> None:
    """Find the unit normals of a face's corners at the last search, where they are not known."""
    for corner in range(3):
        vertex = body.faces[face, corner]
        if passage.known[vertex] == passage.searches[0]:
            continue
        passage.known[vertex] = passage.searches[0]
        total = ZERO, ZERO, ZERO
        for k in range(body.around_starts[vertex], body.around_starts[vertex + 1]):
            total = add(total, _normal_at(body.faces, passage.points, body.around[k], vertex))
        store(passage.normals, vertex, unit(total))


@inlined
def _normal_at(faces: Array, points: Array, face: int, vertex: int) -> Vector:
    """Normal of a face, as long as its angle at one of its vertices."""
    a, b, c = corners(faces, points, face)
    if faces[face, 1] == vertex:
        a, b, c = b, c, a
    elif faces[face, 2] == vertex:
        a, b, c = c, a, b
    one, other = sub(b, a), sub(c, a)
    normal = cross(one, other)
    area = length(normal)
    return scale(angle(area, dot(one, other)) / (area + TINY), normal)


@inlined
def walk(
    body: Body, start: Array, end: Array, share: Number, face: int, point: Vector, steps: int
) -> tuple[int, Vector, Vector]:
    """Walk from a moving face over neighbours to a closer one.

    Returns it, the barycentric coordinates of its closest point, and the way from there to the point.
    """
    weights, away = _nearby(body.faces, start, end, share, face, point)
    for _ in range(steps):
        here, least = face, dot(away, away) - np.float32(1e-12)
        corner = _corner_of(weights)
        if corner >= 0:
            # The closest point is a corner: each face around it may be closer.
            vertex = body.faces[here, corner]
            first, last = body.around_starts[vertex], body.around_starts[vertex + 1]
        else:
            edge = 1 if weights[0] <= ZERO else 2 if weights[1] <= ZERO else 0
            if weights[(edge + 2) % 3] > ZERO or body.neighbours[here, edge] < 0:
                break
            first, last = 0, 1
        for k in range(first, last):
            other = body.around[k] if corner >= 0 else body.neighbours[here, edge]
            barycentrics, farther = _nearby(body.faces, start, end, share, other, point)
            if dot(farther, farther) < least:
                face, weights, away, least = other, barycentrics, farther, dot(farther, farther)
        if face == here:
            break
    return face, weights, away


@inlined
def _corner_of(weights: Vector) -> int:
    """Corner of a face that barycentric coordinates are at, or -1."""
    if weights[0] <= ZERO:
        return 2 if weights[1] <= ZERO else 1 if weights[2] <= ZERO else -1
    return 0 if weights[1] <= ZERO and weights[2] <= ZERO else -1


@inlined
def corners(faces: Array, points: Array, face: int) -> tuple[Vector, Vector, Vector]:
    return load(points, faces[face, 0]), load(points, faces[face, 1]), load(points, faces[face, 2])


@inlined
def _nearby(
    faces: Array, start: Array, end: Array, share: Number, face: int, point: Vector
) -> tuple[Vector, Vector]:
    """Barycentric coordinates of the closest point of a moving face, and the way from there to the point."""
    a = _between(start, end, share, faces[face, 0])
    b = _between(start, end, share, faces[face, 1])
    c = _between(start, end, share, faces[face, 2])
    weights = closest_barycentrics(point, a, b, c)
    return weights, sub(point, weighted(weights, a, b, c))


@inlined
def _between(start: Array, end: Array, share: Number, vertex: int) -> Vector:
    return combine(ONE - share, load(start, vertex), share, load(end, vertex))
