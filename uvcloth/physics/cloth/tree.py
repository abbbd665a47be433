"""Trees of boxes over the faces of moving meshes: built once, refitted as the mesh moves."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rasterize.charts import edge_twins
from uvcloth.physics.cloth.triangles import squared_distance
from uvcloth.physics.cloth.vectors import ZERO, Array, Number, Vector
from uvcloth.process.compiled import borrowing, compiled, inlined

DEPTH = 128
"""Nodes that a walk through a tree has to remember at most."""

BODY_LEAF, SHEET_LEAF = 4, 1
"""Most faces in a leaf of a body, and of a sheet."""

FAR = np.float32(1e30)
"""Squared distance, m2, beyond all."""

APART, DONE = -1, -2
"""Instead of the number of a pair of nodes: they share no vertex; they are two faces that share one."""


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


def _split(centres: NDArray[np.float32], leaf: int) -> tuple[NDArray, NDArray, NDArray]:
    """Halve faces by their centres (M, 3) until at most `leaf` are left: children, ranges, order.

    All nodes of a level are halved at once, each along its widest axis.
    """
    order, count = np.arange(len(centres)), 1
    starts, ends = np.array([0]), np.array([len(centres)])
    children, ranges = [], []
    while len(starts):
        halved = ends - starts > leaf
        first = np.full(len(starts), -1)
        first[halved] = count + 2 * np.arange(halved.sum())
        children.append(np.stack([first, np.where(halved, first + 1, -1)], 1))
        ranges.append(np.stack([starts, ends], 1))
        starts, ends = starts[halved], ends[halved]
        count += 2 * len(starts)
        if len(starts):
            sizes = ends - starts
            offsets = np.cumsum(sizes) - sizes
            node = np.repeat(np.arange(len(starts)), sizes)
            rows = np.arange(len(node)) + (starts - offsets)[node]
            points = centres[order[rows]]
            widths = np.maximum.reduceat(points, offsets) - np.minimum.reduceat(points, offsets)
            along = points[np.arange(len(node)), widths.argmax(1)[node]]
            order[rows] = order[rows][np.lexsort((along, node))]
        middles = (starts + ends) // 2
        starts, ends = np.stack([starts, middles], 1).ravel(), np.stack([middles, ends], 1).ravel()
    return np.concatenate(children), np.concatenate(ranges), order


@compiled
def _find_connected(ranges: Array, order: Array, neighbours: Array, connected: Array) -> None:
    """Mark the nodes whose faces are connected by edges."""
    place = np.empty(len(order), np.int32)
    for k in range(len(order)):
        place[order[k]] = k
    visited = np.full(len(order), -1, np.int32)
    waiting = np.empty(len(order), np.int32)
    for node in range(len(ranges)):
        start, end = ranges[node, 0], ranges[node, 1]
        waiting[0] = order[start]
        visited[order[start]] = node
        count, head = 1, 0
        while head < count:
            face = waiting[head]
            head += 1
            for j in range(3):
                other = neighbours[face, j]
                if other >= 0 and visited[other] != node and start <= place[other] < end:
                    visited[other] = node
                    waiting[count] = other
                    count += 1
        connected[node] = count == end - start


class Patches(NamedTuple):
    """Parts of a tree whose boxes are fitted only where a search comes to them.

    roots: (P,) int32, nodes. number: (T,) int32 of the patch of a root, -1 of other nodes. above: nodes above
    the roots, children first. nodes, vertices: those of each patch, children first, from node_starts and
    vertex_starts, (P + 1,), on.
    """

    roots: NDArray[np.int32]
    number: NDArray[np.int32]
    above: NDArray[np.int32]
    nodes: NDArray[np.int32]
    node_starts: NDArray[np.int32]
    vertices: NDArray[np.int32]
    vertex_starts: NDArray[np.int32]


def find_patches(tree: Tree, faces: NDArray[np.integer], most: int) -> Patches:
    """Cut a tree at its highest nodes of at most so many faces."""
    sizes = tree.ranges[:, 1] - tree.ranges[:, 0]
    patch = np.full(len(sizes), -1)
    roots: list[int] = []
    for node in range(len(sizes)):
        if patch[node] < 0 and sizes[node] <= most:
            patch[node] = len(roots)
            roots.append(node)
        if patch[node] >= 0 and tree.children[node, 0] >= 0:
            patch[tree.children[node]] = patch[node]
    number = np.full(len(sizes), -1, np.int32)
    number[roots] = np.arange(len(roots))
    children_first = np.arange(len(sizes))[::-1]
    inside = children_first[patch[children_first] >= 0]
    inside = inside[np.argsort(patch[inside], kind="stable")]
    corners = [np.unique(faces[tree.order[slice(*tree.ranges[root])]]) for root in roots]
    return Patches(
        roots=np.array(roots, np.int32),
        number=number,
        above=children_first[patch[children_first] < 0].astype(np.int32),
        nodes=inside.astype(np.int32),
        node_starts=np.searchsorted(patch[inside], np.arange(len(roots) + 1)).astype(np.int32),
        vertices=np.concatenate([np.zeros(0), *corners]).astype(np.int32),
        vertex_starts=np.cumsum([0, *(len(each) for each in corners)]).astype(np.int32),
    )


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


def adjacent_walk(tree: Tree, adjacent: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Numbers in `adjacent` of the pairs with which a walk through pairs of nodes goes on.

    adjacent: (P,), of `adjacent_nodes`. Returns the pair (T,) of each node's two children, and the two pairs
    (P, 2) after each pair: APART for nodes that share no vertex, DONE for two faces that share one.
    """
    nodes = len(tree.ranges)
    leaf = tree.children[:, 0] < 0
    sizes = tree.ranges[:, 1] - tree.ranges[:, 0]
    a, b = np.divmod(adjacent, nodes)
    halve_a = np.where(leaf[a] | leaf[b], leaf[b], sizes[a] >= sizes[b])[:, None]
    ends = leaf[a] & leaf[b]
    following = _numbered(
        tree,
        adjacent,
        np.where(halve_a, tree.children[a], a[:, None]),
        np.where(halve_a, b[:, None], tree.children[b]),
    )
    following[ends] = DONE
    return _numbered(tree, adjacent, tree.children[:, 0], tree.children[:, 1]), following


def _numbered(tree: Tree, adjacent: NDArray[np.int64], a: NDArray, b: NDArray) -> NDArray[np.int32]:
    """Numbers of pairs of nodes, APART for those that are not adjacent, DONE for those of two leaves."""
    keys = a.astype(np.int64) * len(tree.ranges) + b
    at = np.searchsorted(adjacent, keys)
    present = np.append(adjacent, -1)[at] == keys
    last = (tree.children[a, 0] < 0) & (tree.children[b, 0] < 0)
    return np.where(present, np.where(last, DONE, at), APART).astype(np.int32)


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


@borrowing
def refit(tree: Tree, faces: Array, points: Array, boxes: Array) -> None:
    """Fit boxes (T, 6), lowest and highest corner, to the faces at points (N, 3)."""
    for node in range(len(boxes) - 1, -1, -1):
        fit_box(tree, faces, points, boxes, node)


@inlined
def fit_box(tree: Tree, faces: Array, points: Array, boxes: Array, node: int) -> None:
    """Fit the box of a node whose children's boxes fit."""
    left, right = tree.children[node, 0], tree.children[node, 1]
    if left >= 0:
        join_boxes(boxes, node, left, right)
        return
    for j in range(3):
        low = high = points[faces[tree.order[tree.ranges[node, 0]], 0], j]
        for k in range(tree.ranges[node, 0], tree.ranges[node, 1]):
            for corner in range(3):
                value = points[faces[tree.order[k], corner], j]
                low, high = min(low, value), max(high, value)
        boxes[node, j] = low
        boxes[node, 3 + j] = high


@inlined
def join_boxes(boxes: Array, node: int, left: int, right: int) -> None:
    """Fit the box of a node to those of its children."""
    for j in range(3):
        boxes[node, j] = min(boxes[left, j], boxes[right, j])
        boxes[node, 3 + j] = max(boxes[left, 3 + j], boxes[right, 3 + j])


@inlined
def box_distance(boxes: Array, node: int, point: Vector) -> Number:
    """Squared distance of a point from a box, 0 inside."""
    total = ZERO
    for j in range(3):
        away = max(boxes[node, j] - point[j], point[j] - boxes[node, 3 + j], ZERO)
        total += away * away
    return total


@inlined
def _fit_patch(
    tree: Tree,
    patches: Patches,
    faces: Array,
    points: Array,
    boxes: Array,
    fitted: Array,
    search: int,
    node: int,
) -> None:
    """Fit the boxes below a node, if it is the root of a patch that was not yet fitted in this search."""
    patch = patches.number[node]
    if patch >= 0 and fitted[patch] != search:
        fitted[patch] = search
        for k in range(patches.node_starts[patch], patches.node_starts[patch + 1]):
            fit_box(tree, faces, points, boxes, patches.nodes[k])


@inlined
def _rounded_up(squared: Number) -> Number:
    """Squared distance, m2, that is greater however it was rounded, within a few metres of the origin."""
    return squared * np.float32(1.001) + np.float32(1e-9)


@inlined
def closest_face(
    tree: Tree,
    patches: Patches,
    root: int,
    boxes: Array,
    fitted: Array,
    search: int,
    faces: Array,
    points: Array,
    point: Vector,
    reach: Number,
    hint: int,
    guess: int,
    stack: Array,
    distances: Array,
) -> tuple[int, Number]:
    """Face of a tree that is closest to a point within reach, m; -1 if none is.

    fitted: (P,), number of the search in which the boxes of each patch were last fitted; patches are
    fitted when needed. hint: a face to begin with, or -1; others have to be closer. guess: a face, or -1,
    that saves time and does not change the result. Also returns, if none is found, the square of a distance
    within which there is none.
    """
    best, face = reach * reach, -1
    if hint >= 0:
        distance = squared_distance(faces, points, hint, point)
        if distance < best:
            best, face = distance, hint
    elif guess >= 0:
        best = min(best, _rounded_up(squared_distance(faces, points, guess, point)))
    beyond = FAR
    stack[0], distances[0] = root, box_distance(boxes, root, point)
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if distances[top] >= best:
            beyond = min(beyond, distances[top])
            continue
        _fit_patch(tree, patches, faces, points, boxes, fitted, search, node)
        left, right = tree.children[node, 0], tree.children[node, 1]
        if left < 0:
            for k in range(tree.ranges[node, 0], tree.ranges[node, 1]):
                distance = squared_distance(faces, points, tree.order[k], point)
                beyond = min(beyond, distance)
                if distance < best:
                    best, face = distance, tree.order[k]
            continue
        to_left, to_right = box_distance(boxes, left, point), box_distance(boxes, right, point)
        near, far = (left, right) if to_left < to_right else (right, left)
        to_near, to_far = min(to_left, to_right), max(to_left, to_right)
        if to_far < best:
            stack[top], distances[top] = far, to_far
            top += 1
        if to_near < best:
            stack[top], distances[top] = near, to_near
            top += 1
        beyond = min(beyond, to_near if to_near >= best else to_far if to_far >= best else FAR)
    return face, beyond
