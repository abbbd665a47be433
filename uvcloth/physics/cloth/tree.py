"""Trees of boxes over the faces of moving meshes: built once, refitted as the mesh moves."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterize.charts import edge_twins
from uvcloth.physics.cloth.triangles import squared_distance
from uvcloth.physics.cloth.vectors import ZERO, Array, Number, Vector
from uvcloth.process.compiled import compiled, inlined

DEPTH = 128
"""Nodes that a walk through a tree has to remember at most."""

BODY_LEAF, SHEET_LEAF = 4, 1
"""Faces in a leaf: a leaf of a sheet is a face, whose box is its own."""


class Tree(NamedTuple):
    """Binary trees of boxes, one after another; children come after their parent.

    children: (T, 2) int32, -1 at a leaf. ranges: (T, 2) int32, the node's faces are order[start:end].
    roots: (K,) int32. connected: (T,) bool, the node's faces are one patch of the mesh.
    """

    children: NDArray[np.int32]
    ranges: NDArray[np.int32]
    order: NDArray[np.int32]
    roots: NDArray[np.int32]
    connected: NDArray[np.bool_]


def build_tree(
    points: NDArray[np.float32], faces: NDArray[np.integer], parts: Iterable[int], leaf: int
) -> Tree:
    """Build a tree for each of several parts at points (N, 3).

    parts: their numbers of faces, which follow one another in faces (M, 3).
    """
    centres = points[faces].mean(1, dtype=np.float32)
    pieces: list[tuple[NDArray, NDArray, NDArray]] = [(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))]
    roots, first, nodes = [], 0, 0
    for count in parts:
        children, ranges, order = _split(centres[first : first + count], leaf)
        pieces.append((np.where(children < 0, -1, children + nodes), ranges + first, order + first))
        roots.append(nodes)
        first, nodes = first + count, nodes + len(children)
    children, ranges, order = (
        np.concatenate(arrays).astype(np.int32) for arrays in zip(*pieces, strict=True)
    )
    connected = np.zeros(len(children), np.bool_)
    _find_connected(ranges, order, neighbour_faces(faces), connected)
    return Tree(children, ranges, order, np.array(roots, np.int32), connected)


def neighbour_faces(faces: NDArray[np.integer]) -> NDArray[np.int32]:
    """Face (M, 3) across each edge, corner i to i + 1; -1 at the border."""
    neighbours = np.full((len(faces), 3), -1, np.int32)
    if len(faces):
        edge, face = np.divmod(edge_twins(faces, np.zeros(0, np.int64)), len(faces))
        neighbours[face, edge] = face[:, ::-1]
    return neighbours


@compiled
def _split(centres: Array, leaf: int) -> tuple[Array, Array, Array]:
    """Halve faces by their centres (M, 3) until at most `leaf` are left: children, ranges, order."""
    count = len(centres)
    children = np.full((2 * count + 1, 2), -1, np.int32)
    ranges = np.zeros((2 * count + 1, 2), np.int32)
    order = np.arange(count)
    ranges[0, 1] = count
    nodes, node = 1, 0
    while node < nodes:
        start, end = ranges[node, 0], ranges[node, 1]
        if end - start > leaf:
            widest, axis = -1.0, 0
            for j in range(3):
                low = high = centres[order[start], j]
                for k in range(start, end):
                    low, high = min(low, centres[order[k], j]), max(high, centres[order[k], j])
                if high - low > widest:
                    widest, axis = high - low, j
            part = order[start:end].copy()
            order[start:end] = part[np.argsort(centres[part, axis], kind="mergesort")]
            middle = (start + end) // 2
            for side in range(2):
                children[node, side] = nodes
                ranges[nodes, 0] = start if side == 0 else middle
                ranges[nodes, 1] = middle if side == 0 else end
                nodes += 1
        node += 1
    return children[:nodes], ranges[:nodes], order


@compiled
def _find_connected(ranges: Array, order: Array, neighbours: Array, connected: Array) -> None:
    """Mark the nodes whose faces hang together by edges."""
    place = np.empty(len(order), np.int32)
    for k in range(len(order)):
        place[order[k]] = k
    seen = np.full(len(order), -1, np.int32)
    waiting = np.empty(len(order), np.int32)
    for node in range(len(ranges)):
        start, end = ranges[node, 0], ranges[node, 1]
        waiting[0] = order[start]
        seen[order[start]] = node
        count, found = 1, 0
        while found < count:
            face = waiting[found]
            found += 1
            for j in range(3):
                other = neighbours[face, j]
                if other >= 0 and seen[other] != node and start <= place[other] < end:
                    seen[other] = node
                    waiting[count] = other
                    count += 1
        connected[node] = count == end - start


@inlined
def first_is_halved(tree: Tree, a: int, b: int) -> bool:
    """True if a walk through pairs of nodes goes on with the children of the first, False of the second."""
    if tree.children[a, 0] < 0 or tree.children[b, 0] < 0:
        return tree.children[b, 0] < 0
    return tree.ranges[a, 1] - tree.ranges[a, 0] >= tree.ranges[b, 1] - tree.ranges[b, 0]


@inlined
def pair_key(tree: Tree, a: int, b: int) -> Number:
    """One integer per pair of nodes."""
    return np.int64(a) * len(tree.ranges) + b


def adjacent_nodes(tree: Tree, faces: NDArray[np.integer]) -> NDArray[np.int64]:
    """Keys, in order, of the pairs of nodes that a walk meets and whose faces share a vertex.

    Leaves are single faces. Trees of different parts share none.
    """
    corners = np.argsort(faces.ravel(), kind="stable")
    starts = np.searchsorted(faces.ravel()[corners], np.arange(int(faces.max(initial=-1)) + 2))
    return np.unique(_adjacent_keys(tree, corners // 3, starts))


@inlined
def _leaves_and_parents(tree: Tree) -> tuple[Array, Array]:
    """Leaf (M,) of each face, and parent (T,) of each node, -1 for a root."""
    leaf = np.empty(len(tree.order), np.int32)
    parent = np.full(len(tree.ranges), -1, np.int32)
    for node in range(len(tree.ranges)):
        if tree.children[node, 0] < 0:
            leaf[tree.order[tree.ranges[node, 0]]] = node
        else:
            parent[tree.children[node, 0]] = parent[tree.children[node, 1]] = node
    return leaf, parent


@compiled
def _adjacent_keys(tree: Tree, owners: Array, starts: Array) -> Array:
    """Keys of the pairs of nodes on the way to each two faces around a vertex.

    owners: the faces around each vertex, those of vertex v from starts[v] on.
    """
    leaf, parent = _leaves_and_parents(tree)
    keys = np.empty(4096, np.int64)
    count = 0
    for vertex in range(len(starts) - 1):
        for i in range(starts[vertex], starts[vertex + 1]):
            for j in range(starts[vertex], i):
                first, second = leaf[owners[i]], leaf[owners[j]]
                if tree.ranges[first, 0] > tree.ranges[second, 0]:
                    first, second = second, first
                common = first
                while tree.ranges[common, 1] <= tree.ranges[second, 0]:
                    common = parent[common]
                a, b = tree.children[common, 0], tree.children[common, 1]
                while True:
                    if count == len(keys):
                        keys = np.concatenate((keys, np.empty_like(keys)))
                    keys[count] = pair_key(tree, a, b)
                    count += 1
                    if tree.children[a, 0] < 0 and tree.children[b, 0] < 0:
                        break
                    if first_is_halved(tree, a, b):
                        left = tree.children[a, 0]
                        a = left if tree.ranges[left, 1] > tree.ranges[first, 0] else tree.children[a, 1]
                    else:
                        left = tree.children[b, 0]
                        b = left if tree.ranges[left, 1] > tree.ranges[second, 0] else tree.children[b, 1]
    return keys[:count]


@compiled
def refit(tree: Tree, faces: Array, points: Array, boxes: Array) -> None:
    """Fit boxes (T, 6), lowest and highest corner, to the faces at points (N, 3)."""
    for node in range(len(boxes) - 1, -1, -1):
        left, right = tree.children[node, 0], tree.children[node, 1]
        if left >= 0:
            for j in range(3):
                boxes[node, j] = min(boxes[left, j], boxes[right, j])
                boxes[node, 3 + j] = max(boxes[left, 3 + j], boxes[right, 3 + j])
            continue
        for j in range(3):
            low = high = points[faces[tree.order[tree.ranges[node, 0]], 0], j]
            for k in range(tree.ranges[node, 0], tree.ranges[node, 1]):
                for corner in range(3):
                    value = points[faces[tree.order[k], corner], j]
                    low, high = min(low, value), max(high, value)
            boxes[node, j] = low
            boxes[node, 3 + j] = high


@inlined
def box_distance(boxes: Array, node: int, point: Vector) -> Number:
    """Squared distance of a point from a box, 0 inside."""
    total = ZERO
    for j in range(3):
        away = max(boxes[node, j] - point[j], point[j] - boxes[node, 3 + j], ZERO)
        total += away * away
    return total


@inlined
def closest_face(
    tree: Tree,
    root: int,
    boxes: Array,
    faces: Array,
    points: Array,
    point: Vector,
    reach: Number,
    hint: int,
    stack: Array,
) -> int:
    """Face of a tree that is closest to a point within reach, m; -1 if none is.

    hint: a face to begin with, or -1.
    """
    best, found = reach * reach, -1
    if hint >= 0:
        distance = squared_distance(faces, points, hint, point)
        if distance < best:
            best, found = distance, hint
    stack[0] = root
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if box_distance(boxes, node, point) >= best:
            continue
        left, right = tree.children[node, 0], tree.children[node, 1]
        if left < 0:
            for k in range(tree.ranges[node, 0], tree.ranges[node, 1]):
                distance = squared_distance(faces, points, tree.order[k], point)
                if distance < best:
                    best, found = distance, tree.order[k]
            continue
        to_left, to_right = box_distance(boxes, left, point), box_distance(boxes, right, point)
        near, far = (left, right) if to_left < to_right else (right, left)
        if max(to_left, to_right) < best:
            stack[top] = far
            top += 1
        if min(to_left, to_right) < best:
            stack[top] = near
            top += 1
    return found
