"""Contact of cloth with itself, and of layers: vertices with faces, edges with edges, each on its side."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uvcloth.physics.cloth.cloth import Sheet
from uvcloth.physics.cloth.tree import APART, DEPTH, DONE, Tree, first_is_halved, refit
from uvcloth.physics.cloth.triangles import closest_barycentrics, closest_on_segments, weighted
from uvcloth.physics.cloth.vectors import (
    HALF,
    ONE,
    TINY,
    TWO,
    ZERO,
    Array,
    Number,
    Vector,
    add,
    clamp,
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

LEAST_FLAT = np.float32(math.cos(math.radians(75.0)))
"""Cosine of the widest half angle of a cone of normals whose patch is not tested against itself."""

PUSH_SPEED = np.float32(0.5)
"""Speed, m/s, at which cloth is moved out of cloth."""

ALERT_SPEED = np.float32(1.0)
"""Speed, m/s, that a pair may gain before it is searched again."""

LOST = np.float32(0.004)
"""Metres on the wrong side, beyond twice the kept distance, from which a vertex is no longer moved."""

LOST_EDGES = np.float32(0.006)
"""The same for two edges."""

TOUCHING = np.float32(1e-6)
"""Metres below which the direction between two points is not defined."""


Corners = tuple[int, int, int, int]
Shares = tuple[Number, Number, Number, Number]


class Pairs(NamedTuple):
    """Parts of cloth that are near each other, with the sides on which they stay.

    points: (P, 2) int32, a vertex and a face. sides: (P,), +1 or -1 along the normal of the face.
    edges: (Q, 2) int32, two edges. directions: (Q, 3), unit, from the second edge to the first.
    """

    points: NDArray[np.int32]
    sides: NDArray[np.float32]
    edges: NDArray[np.int32]
    directions: NDArray[np.float32]


def no_pairs() -> Pairs:
    """No pairs."""
    return Pairs(
        np.zeros((0, 2), np.int32),
        np.zeros(0, np.float32),
        np.zeros((0, 2), np.int32),
        np.zeros((0, 3), np.float32),
    )


@compiled
def find_pairs(
    sheet: Sheet,
    positions: Array,
    velocities: Array,
    margin: Number,
    interval: Number,
    before: Pairs,
    boxes: Array,
    speeds: Array,
    cones: Array,
) -> Pairs:
    """Find the pairs of the cloth that are within margin, m, or may get there within an interval, s.

    before: pairs whose sides are remembered. boxes, speeds: (T, 6), cones: (T, 5) are filled.

    A patch of the mesh whose normals lie in a narrow cone is not tested against itself (Volino and
    Magnenat-Thalmann 1994): at a half angle a, points that are `spacing` apart along it keep a distance of
    spacing cos(a), more than the margin.
    """
    tree = sheet.tree
    flat = max(margin / sheet.spacing, LEAST_FLAT)
    refit(tree, sheet.faces, positions, boxes)
    refit(tree, sheet.faces, velocities, speeds)
    _fit_cones(sheet, positions, cones)
    stack = np.empty((len(tree.roots) ** 2 + 2 * DEPTH, 3), np.int32)
    leaves = np.empty((len(sheet.faces), 2), np.int32)
    count = _walk(sheet, boxes, speeds, cones, positions, margin, interval, flat, stack, leaves)
    if count > len(leaves):
        leaves = np.empty((count, 2), np.int32)
        _walk(sheet, boxes, speeds, cones, positions, margin, interval, flat, stack, leaves)
    near, crossed = np.empty((6 * count, 2), np.int32), np.empty((9 * count, 2), np.int32)
    points, edges = _look_through(sheet, speeds, positions, margin, interval, leaves[:count], near, crossed)
    return _with_sides(sheet, positions, near[:points].copy(), crossed[:edges].copy(), before)


@borrowing
def _walk(
    sheet: Sheet,
    boxes: Array,
    speeds: Array,
    cones: Array,
    positions: Array,
    margin: Number,
    interval: Number,
    flat: Number,
    stack: Array,
    leaves: Array,
) -> int:
    """Find the pairs of nodes of single faces that may be near, and put those that fit into leaves (L, 2).

    stack: holds two nodes, and the number of their pair if they share a vertex. Returns how many there are.
    """
    tree = sheet.tree
    top = count = 0
    for i in range(len(tree.roots)):
        for j in range(i, len(tree.roots)):
            if sheet.apart[i, j]:
                continue
            stack[top, 0], stack[top, 1], stack[top, 2] = tree.roots[i], tree.roots[j], APART
            top += 1
    while top > 0:
        top -= 1
        a, b, pair = stack[top, 0], stack[top, 1], stack[top, 2]
        if a == b:
            if tree.children[a, 0] >= 0 and not (tree.connected[a] and cones[a, 3] > flat):
                top = _add_children(sheet, a, stack, top)
            continue
        # Nodes that share a vertex are not apart, and those that do not are no one patch.
        if (
            _apart(boxes, speeds, a, b, margin, interval)
            if pair == APART
            else _one_patch(tree, cones, a, b, flat)
        ):
            continue
        if tree.children[a, 0] >= 0 or tree.children[b, 0] >= 0:
            top = _add_halves(sheet, a, b, pair, stack, top)
            continue
        f, g = tree.order[tree.ranges[a, 0]], tree.order[tree.ranges[b, 0]]
        watched = margin + interval * _relative_speed(speeds, a, b)
        if _off_plane(sheet.faces, positions, f, load(cones, a), g, watched) or _off_plane(
            sheet.faces, positions, g, load(cones, b), f, watched
        ):
            continue
        if count < len(leaves):
            leaves[count, 0], leaves[count, 1] = a, b
        count += 1
    return count


@borrowing
def _look_through(
    sheet: Sheet,
    speeds: Array,
    positions: Array,
    margin: Number,
    interval: Number,
    leaves: Array,
    near: Array,
    crossed: Array,
) -> tuple[int, int]:
    """Find and count vertices near faces, (6 L, 2), and edges near edges, (9 L, 2), in L pairs of leaves."""
    points = edges = 0
    for k in range(len(leaves)):
        a, b = leaves[k, 0], leaves[k, 1]
        f, g = sheet.tree.order[sheet.tree.ranges[a, 0]], sheet.tree.order[sheet.tree.ranges[b, 0]]
        watched = margin + interval * _relative_speed(speeds, a, b)
        for _ in range(2):
            points = _find_points(sheet, positions, f, g, watched, near, points)
            f, g = g, f
        edges = _find_edges(sheet, positions, f, g, watched, crossed, edges)
    return points, edges


@inlined
def _add_children(sheet: Sheet, node: int, stack: Array, top: int) -> int:
    """Add the pairs of a node's children, each with itself and both; returns how many pairs wait."""
    left, right = sheet.tree.children[node, 0], sheet.tree.children[node, 1]
    stack[top, 0], stack[top, 1] = left, left
    stack[top + 1, 0], stack[top + 1, 1] = right, right
    stack[top + 2, 0], stack[top + 2, 1], stack[top + 2, 2] = left, right, sheet.halves[node]
    return top + 2 if sheet.halves[node] == DONE else top + 3


@inlined
def _add_halves(sheet: Sheet, a: int, b: int, pair: int, stack: Array, top: int) -> int:
    """Add the pairs of one of two nodes with the children of the other; returns how many pairs wait."""
    children = sheet.tree.children
    halve_a = first_is_halved(sheet.tree, a, b)
    for side in range(2):
        following = APART if pair == APART else sheet.following[pair, side]
        if following != DONE:
            stack[top, 0] = children[a, side] if halve_a else a
            stack[top, 1] = b if halve_a else children[b, side]
            stack[top, 2] = following
            top += 1
    return top


@inlined
def _apart(boxes: Array, speeds: Array, a: int, b: int, margin: Number, interval: Number) -> bool:
    """True for two nodes that stay farther apart than margin, m, along an axis for an interval, s."""
    for j in range(3):
        a_below = max(speeds[a, 3 + j] - speeds[b, j], ZERO)
        b_below = max(speeds[b, 3 + j] - speeds[a, j], ZERO)
        if (
            boxes[a, j] > boxes[b, 3 + j] + margin + interval * b_below
            or boxes[b, j] > boxes[a, 3 + j] + margin + interval * a_below
        ):
            return True
    return False


@inlined
def _relative_speed(speeds: Array, a: int, b: int) -> Number:
    """Greatest speed, m/s, of a part of one node relative to a part of the other."""
    total = ZERO
    for j in range(3):
        along = max(speeds[a, 3 + j] - speeds[b, j], speeds[b, 3 + j] - speeds[a, j])
        total += along * along
    return math.sqrt(total)


@inlined
def _off_plane(faces: Array, positions: Array, f: int, normal: Vector, g: int, margin: Number) -> bool:
    """True if face g is farther than margin from the plane of face f, all on one side."""
    on_plane = load(positions, faces[f, 0])
    low = high = dot(sub(load(positions, faces[g, 0]), on_plane), normal)
    for corner in range(1, 3):
        height = dot(sub(load(positions, faces[g, corner]), on_plane), normal)
        low, high = min(low, height), max(high, height)
    return low > margin or high < -margin


@borrowing
def _fit_cones(sheet: Sheet, positions: Array, cones: Array) -> None:
    """Fit cones (T, 5), axis, cosine and sine of the half angle, around the normals of each node's faces."""
    tree = sheet.tree
    for node in range(len(cones) - 1, -1, -1):
        left, right = tree.children[node, 0], tree.children[node, 1]
        if left < 0:
            face = tree.order[tree.ranges[node, 0]]
            a, b, c = _corners(sheet.faces, positions, face)
            store(cones, node, unit(cross(sub(b, a), sub(c, a))))
            cones[node, 3], cones[node, 4] = ONE, ZERO
            continue
        axis = unit(add(load(cones, left), load(cones, right)))
        store(cones, node, axis)
        cosine = min(_widened(cones, left, axis), _widened(cones, right, axis))
        cones[node, 3], cones[node, 4] = cosine, math.sqrt(ONE - cosine * cosine)


@inlined
def _widened(cones: Array, node: int, axis: Vector) -> Number:
    """Cosine of the half angle of a cone around an axis that holds a node's; -1 from a quarter turn on."""
    along = clamp(dot(axis, load(cones, node)), -ONE, ONE)
    cosine = along * cones[node, 3] - math.sqrt(ONE - along * along) * cones[node, 4]
    return cosine if along > ZERO and cones[node, 3] > ZERO and cosine > ZERO else -ONE


@inlined
def _one_patch(tree: Tree, cones: Array, a: int, b: int, flat: Number) -> bool:
    """True for two adjacent nodes that are one patch, all normals within an angle of cosine `flat`."""
    if not tree.connected[a] or not tree.connected[b] or cones[a, 3] < flat or cones[b, 3] < flat:
        return False
    axis = unit(add(load(cones, a), load(cones, b)))
    return bool(min(_widened(cones, a, axis), _widened(cones, b, axis)) >= flat)


@inlined
def _corners(faces: Array, positions: Array, face: int) -> tuple[Vector, Vector, Vector]:
    return load(positions, faces[face, 0]), load(positions, faces[face, 1]), load(positions, faces[face, 2])


@inlined
def _in_ring(sheet: Sheet, vertex: int, other: int) -> bool:
    """True for a vertex itself and those on an edge with it."""
    if vertex == other:
        return True
    for k in range(sheet.ring_starts[vertex], sheet.ring_starts[vertex + 1]):
        if sheet.ring[k] == other:
            return True
    return False


@inlined
def _find_points(
    sheet: Sheet, positions: Array, f: int, g: int, margin: Number, near: Array, count: int
) -> int:
    """Add the vertices that face f stands for and that are within margin of face g."""
    a, b, c = _corners(sheet.faces, positions, g)
    normal = unit(cross(sub(b, a), sub(c, a)))
    for corner in range(3):
        if not (sheet.owned[f] >> corner) & 1:
            continue
        vertex = sheet.faces[f, corner]
        point = load(positions, vertex)
        if abs(dot(sub(point, a), normal)) > margin:
            continue
        if (
            _in_ring(sheet, vertex, sheet.faces[g, 0])
            or _in_ring(sheet, vertex, sheet.faces[g, 1])
            or _in_ring(sheet, vertex, sheet.faces[g, 2])
        ):
            continue
        away = sub(point, weighted(closest_barycentrics(point, a, b, c), a, b, c))
        if dot(away, away) <= margin * margin:
            near[count, 0], near[count, 1] = vertex, g
            count += 1
    return count


@inlined
def _find_edges(
    sheet: Sheet, positions: Array, f: int, g: int, margin: Number, near: Array, count: int
) -> int:
    """Add the edges that faces f and g stand for and that are within margin of each other."""
    for i in range(3):
        if not (sheet.owned[f] >> (3 + i)) & 1:
            continue
        first = sheet.face_edges[f, i]
        p, q = sheet.edges[first, 0], sheet.edges[first, 1]
        xp, xq = load(positions, p), load(positions, q)
        for j in range(3):
            if not (sheet.owned[g] >> (3 + j)) & 1:
                continue
            second = sheet.face_edges[g, j]
            r, s = sheet.edges[second, 0], sheet.edges[second, 1]
            xr, xs = load(positions, r), load(positions, s)
            separate = False
            for k in range(3):
                if (
                    min(xp[k], xq[k]) > max(xr[k], xs[k]) + margin
                    or min(xr[k], xs[k]) > max(xp[k], xq[k]) + margin
                ):
                    separate = True
            if (
                separate
                or _in_ring(sheet, p, r)
                or _in_ring(sheet, p, s)
                or _in_ring(sheet, q, r)
                or _in_ring(sheet, q, s)
            ):
                continue
            between = closest_on_segments(xp, xq, xr, xs)[2]
            if dot(between, between) <= margin * margin:
                near[count, 0], near[count, 1] = first, second
                count += 1
    return count


@compiled
def _with_sides(sheet: Sheet, positions: Array, points: Array, edges: Array, before: Pairs) -> Pairs:
    """Pairs on the sides that they had before, or on those that they are on."""
    sides = np.empty(len(points), np.float32)
    starts, order = _grouped(before.points, len(positions))
    for k in range(len(points)):
        vertex, face = points[k, 0], points[k, 1]
        a, b, c = _corners(sheet.faces, positions, face)
        away = dot(sub(load(positions, vertex), a), cross(sub(b, a), sub(c, a)))
        sides[k] = ONE if away >= ZERO else -ONE
        for i in range(starts[vertex], starts[vertex + 1]):
            if before.points[order[i], 1] == face:
                sides[k] = before.sides[order[i]]
    directions = np.empty((len(edges), 3), np.float32)
    starts, order = _grouped(before.edges, len(sheet.edges))
    for k in range(len(edges)):
        first, second = edges[k, 0], edges[k, 1]
        between = _between(sheet, positions, first, second)[2]
        store(directions, k, scale(ONE / (length(between) + TINY), between))
        for i in range(starts[first], starts[first + 1]):
            if before.edges[order[i], 1] == second:
                store(directions, k, load(before.directions, order[i]))
    return Pairs(points, sides, edges, directions)


@compiled
def _grouped(pairs: Array, count: int) -> tuple[Array, Array]:
    """Rows of pairs (P, 2) ordered by their first index: where each of `count` begins, and the order."""
    starts = np.zeros(count + 1, np.int32)
    for k in range(len(pairs)):
        starts[pairs[k, 0] + 1] += 1
    for k in range(count):
        starts[k + 1] += starts[k]
    following, order = starts.copy(), np.empty(len(pairs), np.int32)
    for k in range(len(pairs)):
        order[following[pairs[k, 0]]] = k
        following[pairs[k, 0]] += 1
    return starts, order


@inlined
def _between(sheet: Sheet, positions: Array, first: int, second: int) -> tuple[Number, Number, Vector]:
    return closest_on_segments(
        load(positions, sheet.edges[first, 0]),
        load(positions, sheet.edges[first, 1]),
        load(positions, sheet.edges[second, 0]),
        load(positions, sheet.edges[second, 1]),
    )


@borrowing
def resolve_pairs(
    pairs: Pairs,
    point_wait: Array,
    edge_wait: Array,
    sheet: Sheet,
    positions: Array,
    velocities: Array,
    inverse_mass: Array,
    radius: Number,
    frictions: Array,
    step: Number,
) -> None:
    """Keep pairs `radius`, m, apart on their sides, without a bounce, with friction.

    point_wait: (P,), edge_wait: (Q,) int32, substeps until a pair is looked at again.
    """
    for k in range(len(pairs.points)):
        if point_wait[k] > 0:
            point_wait[k] -= 1
        else:
            point_wait[k] = _resolve_point(
                pairs, k, sheet, positions, velocities, inverse_mass, radius, frictions, step
            )
    for k in range(len(pairs.edges)):
        if edge_wait[k] > 0:
            edge_wait[k] -= 1
        else:
            edge_wait[k] = _resolve_edges(
                pairs, k, sheet, positions, velocities, inverse_mass, radius, frictions, step
            )


@inlined
def _resolve_point(
    pairs: Pairs,
    k: int,
    sheet: Sheet,
    positions: Array,
    velocities: Array,
    inverse_mass: Array,
    radius: Number,
    frictions: Array,
    step: Number,
) -> int:
    vertex, face = pairs.points[k, 0], pairs.points[k, 1]
    a, b, c = sheet.faces[face, 0], sheet.faces[face, 1], sheet.faces[face, 2]
    point = load(positions, vertex)
    xa, xb, xc = load(positions, a), load(positions, b), load(positions, c)
    normal = scale(pairs.sides[k], unit(cross(sub(xb, xa), sub(xc, xa))))
    height = dot(sub(point, xa), normal)
    weights = closest_barycentrics(point, xa, xb, xc)
    inside = weights[0] > ZERO and weights[1] > ZERO and weights[2] > ZERO
    away = sub(point, weighted(weights, xa, xb, xc))
    distance = length(away)
    gap = (height if inside else distance) - radius
    corners = vertex, a, b, c
    shares = ONE, -weights[0], -weights[1], -weights[2]
    if gap >= ZERO:
        return _until(gap, _relative(velocities, corners, shares), step)
    if inside:
        if gap < -TWO * radius - LOST:
            return 0
    else:
        # Beside a face, the side of a vertex is not defined.
        if height < ZERO or distance < TOUCHING:
            return 0
        normal = scale(ONE / distance, away)
    _separate(corners, shares, normal, gap, positions, velocities, inverse_mass, frictions, step)
    return 0


@inlined
def _resolve_edges(
    pairs: Pairs,
    k: int,
    sheet: Sheet,
    positions: Array,
    velocities: Array,
    inverse_mass: Array,
    radius: Number,
    frictions: Array,
    step: Number,
) -> int:
    first, second = pairs.edges[k, 0], pairs.edges[k, 1]
    s, t, between = _between(sheet, positions, first, second)
    distance = length(between)
    crossed = dot(between, load(pairs.directions, k)) < ZERO
    corners = sheet.edges[first, 0], sheet.edges[first, 1], sheet.edges[second, 0], sheet.edges[second, 1]
    shares = ONE - s, s, t - ONE, -t
    if not crossed:
        if distance > TOUCHING:
            store(pairs.directions, k, scale(ONE / distance, between))
        if distance >= radius:
            return _until(distance - radius, _relative(velocities, corners, shares), step)
    if s <= ZERO or s >= ONE or t <= ZERO or t >= ONE or (crossed and distance > LOST_EDGES):
        return 0
    normal = load(pairs.directions, k)
    if crossed:
        if distance > TOUCHING:
            normal = scale(-ONE / distance, between)
        distance = -distance
    _separate(
        corners, shares, normal, distance - radius, positions, velocities, inverse_mass, frictions, step
    )
    return 0


@inlined
def _until(gap: Number, relative: Vector, step: Number) -> int:
    """Substeps in which a pair with a gap, m, cannot touch."""
    return int(gap / (TWO * step * (length(relative) + ALERT_SPEED)))


@inlined
def _relative(velocities: Array, corners: Corners, shares: Shares) -> Vector:
    return add(
        combine(shares[0], load(velocities, corners[0]), shares[1], load(velocities, corners[1])),
        combine(shares[2], load(velocities, corners[2]), shares[3], load(velocities, corners[3])),
    )


@inlined
def _separate(
    corners: Corners,
    shares: Shares,
    normal: Vector,
    gap: Number,
    positions: Array,
    velocities: Array,
    inverse_mass: Array,
    frictions: Array,
    step: Number,
) -> None:
    """Move four vertices apart along a normal by a negative gap, and stop their approach."""
    light = ZERO
    for j in range(4):
        light += shares[j] * shares[j] * inverse_mass[corners[j]]
    relative = _relative(velocities, corners, shares)
    approach = dot(relative, normal)
    shift = min(-gap, PUSH_SPEED * step) / light
    impulse = max(-approach, ZERO) / light
    along = sub(relative, scale(approach, normal))
    speed = length(along)
    friction = HALF * (frictions[corners[0]] + frictions[corners[3]])
    slowed = min(friction * impulse, speed / light) / (speed + TINY)
    for j in range(4):
        share = shares[j] * inverse_mass[corners[j]]
        store(positions, corners[j], combine(ONE, load(positions, corners[j]), shift * share, normal))
        change = combine(impulse * share, normal, -slowed * share, along)
        store(velocities, corners[j], add(load(velocities, corners[j]), change))
