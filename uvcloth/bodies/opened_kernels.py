"""Compiled loops that push the parts of a collider apart, frame after frame on one thread.

A side is one part of a pair against the other; sides 2k and 2k + 1 are pair k. Signed distances are moving
least squares over the points of the other side: its tangent planes, weighted by a smooth function of the
distance and by how much the two skins face each other. So a small change of the pose is a small change of
the result, where a nearest face would switch.
"""

import heapq
from typing import NamedTuple

import numba
import numpy as np

REACH = 0.08
"""Metres within which points of two parts act on each other."""

ROUNDS = 5
"""Times that distances are measured and pushes corrected."""

FULL_WEIGHT = 1.0e4
"""Sum of the weights, 1/m4, from which a distance counts in full: that of one facing point 6 cm away."""

FAR = np.float32(1.0e9)
"""Metres that stand for no distance: fast arithmetic knows no infinity."""

_compiled = numba.njit(cache=True, fastmath=True, error_model="numpy", nogil=True)


class Plan(NamedTuple):
    """What is known of a collider of C vertices before it moves, for S sides with K points in all.

    starts: (S + 1,) int32, of each side its first point. points: (K,) int32 vertices, and of each
    want: (K,) m, the distance that it keeps from the other part, and core: (K,) m2, the squared distance
    within which the points of a wall count alike. slope: of a push along the skin, metres for each metre.
    allowed: (S, C) m, the longest push of each vertex.

    ring_starts: (C + 1,) int32, of each vertex its first row in rings: (R, 2) int32, the other corners of
    the faces around it. spread_starts: (C + 1,) int32, of each vertex that is a point its first row in
    spread_vertices: (M,) int32, the vertices that move with it, at spread_lengths: (M,) m along the skin.

    tips: (T,) int32, the tips of the caps, and rim_starts: (T + 1,) int32, of each its first row in
    rims: (E,) int32, the vertices around it.
    """

    starts: np.ndarray
    points: np.ndarray
    want: np.ndarray
    core: np.ndarray
    slope: float
    allowed: np.ndarray
    ring_starts: np.ndarray
    rings: np.ndarray
    spread_starts: np.ndarray
    spread_vertices: np.ndarray
    spread_lengths: np.ndarray
    tips: np.ndarray
    rim_starts: np.ndarray
    rims: np.ndarray


@_compiled
def open_frames(frames: np.ndarray, plan: Plan) -> None:
    """Push the parts of collider vertices (F, C, 3) float32 m apart, in place."""
    points, vertices = len(plan.points), frames.shape[1]
    near, counts = np.empty(points, np.int32), np.empty(len(plan.starts) - 1, np.int32)
    places, normals = np.empty((points, 3), np.float32), np.empty((points, 3), np.float32)
    sums, push = np.zeros((points, 5), np.float32), np.empty(points, np.float32)
    shift, side_shift = np.zeros((vertices, 3), np.float32), np.zeros((vertices, 5), np.float32)
    moved, marked = np.empty(vertices, np.int32), np.zeros(vertices, np.bool_)
    for frame in range(len(frames)):
        corners = frames[frame]
        _find_near(corners, plan, near, counts, places)
        _find_normals(corners, plan, near, counts, normals)
        first, second, facing = _find_pairs(plan, near, counts, places, normals)
        if not len(first):
            continue
        push[:] = 0.0
        amount = 0
        for each in range(ROUNDS):
            _measure(plan, near, counts, places, normals, first, second, facing, sums)
            pushed = _correct(plan, near, counts, sums, push)
            if each == 0 and not pushed:
                break
            amount = _spread(plan, near, counts, push, sums, shift, side_shift, moved, marked, amount)
            _follow(corners, plan, near, counts, shift, places)
        for row in range(amount):
            vertex = moved[row]
            for axis in range(3):
                corners[vertex, axis] += shift[vertex, axis]
        _move_tips(corners, plan, shift)
        for row in range(amount):
            shift[moved[row]] = 0.0
            marked[moved[row]] = False


@_compiled
def distances(corners: np.ndarray, plan: Plan) -> np.ndarray:
    """Signed distances (K,) m of the points of collider vertices (C, 3) to the other parts, else FAR."""
    points = len(plan.points)
    near, counts = np.empty(points, np.int32), np.empty(len(plan.starts) - 1, np.int32)
    places, normals = np.empty((points, 3), np.float32), np.empty((points, 3), np.float32)
    sums, found = np.zeros((points, 5), np.float32), np.full(points, FAR, np.float32)
    _find_near(corners, plan, near, counts, places)
    _find_normals(corners, plan, near, counts, normals)
    first, second, facing = _find_pairs(plan, near, counts, places, normals)
    _measure(plan, near, counts, places, normals, first, second, facing, sums)
    for side in range(len(counts)):
        for row in range(plan.starts[side], plan.starts[side] + counts[side]):
            point = near[row]
            if sums[point, 0] > 0:
                found[point] = sums[point, 1] / sums[point, 0]
    return found


@_compiled
def _find_near(
    corners: np.ndarray, plan: Plan, near: np.ndarray, counts: np.ndarray, places: np.ndarray
) -> None:
    """Find the points of each side that are within reach of the box around the other side, and their places.

    Those of a side lie in `near` from its first point on.
    """
    sides = len(counts)
    low, high = np.full((sides, 3), FAR, np.float32), np.full((sides, 3), -FAR, np.float32)
    for side in range(sides):
        for point in range(plan.starts[side], plan.starts[side + 1]):
            for axis in range(3):
                place = corners[plan.points[point], axis]
                low[side, axis] = min(low[side, axis], place)
                high[side, axis] = max(high[side, axis], place)
    for side in range(sides):
        other, start, count = side ^ 1, plan.starts[side], 0
        for point in range(start, plan.starts[side + 1]):
            inside = True
            for axis in range(3):
                place = corners[plan.points[point], axis]
                inside &= (place > low[other, axis] - REACH) and (place < high[other, axis] + REACH)
            if inside:
                near[start + count] = point
                places[point] = corners[plan.points[point]]
                count += 1
        counts[side] = count


@_compiled
def _find_normals(
    corners: np.ndarray, plan: Plan, near: np.ndarray, counts: np.ndarray, normals: np.ndarray
) -> None:
    """Find the outward unit normals of the near points."""
    for side in range(len(counts)):
        for row in range(plan.starts[side], plan.starts[side] + counts[side]):
            point = near[row]
            vertex = plan.points[point]
            px, py, pz = corners[vertex, 0], corners[vertex, 1], corners[vertex, 2]
            nx, ny, nz = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            for face in range(plan.ring_starts[vertex], plan.ring_starts[vertex + 1]):
                a, b = plan.rings[face, 0], plan.rings[face, 1]
                ax, ay, az = corners[a, 0] - px, corners[a, 1] - py, corners[a, 2] - pz
                bx, by, bz = corners[b, 0] - px, corners[b, 1] - py, corners[b, 2] - pz
                nx += ay * bz - az * by
                ny += az * bx - ax * bz
                nz += ax * by - ay * bx
            length = max(np.sqrt(nx * nx + ny * ny + nz * nz), np.float32(1e-12))
            normals[point, 0], normals[point, 1], normals[point, 2] = nx / length, ny / length, nz / length


@_compiled
def _find_pairs(
    plan: Plan, near: np.ndarray, counts: np.ndarray, places: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the points of the two sides of each pair that are within reach and face each other.

    Returns the two points of each and how much they face each other, 0 to 1.
    """
    most = 0
    for side in range(0, len(counts), 2):
        most += counts[side] * counts[side + 1]
    first, second = np.empty(most, np.int32), np.empty(most, np.int32)
    facing, total = np.empty(most, np.float32), 0
    reach = np.float32(REACH * REACH)
    for side in range(0, len(counts), 2):
        other, there = plan.starts[side + 1], counts[side + 1]
        for row in range(plan.starts[side], plan.starts[side] + counts[side]):
            i = near[row]
            px, py, pz = places[i, 0], places[i, 1], places[i, 2]
            nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
            for column in range(other, other + there):
                j = near[column]
                x, y, z = places[j, 0] - px, places[j, 1] - py, places[j, 2] - pz
                if x * x + y * y + z * z < reach:
                    against = -(nx * normals[j, 0] + ny * normals[j, 1] + nz * normals[j, 2])
                    if against > 0:
                        first[total], second[total], facing[total] = i, j, against * against
                        total += 1
    return first[:total], second[:total], facing[:total]


@_compiled
def _measure(
    plan: Plan,
    near: np.ndarray,
    counts: np.ndarray,
    places: np.ndarray,
    normals: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    facing: np.ndarray,
    sums: np.ndarray,
) -> None:
    """Sum up for each near point its weights, its weighted distances to tangent planes, and their normals."""
    for side in range(len(counts)):
        for row in range(plan.starts[side], plan.starts[side] + counts[side]):
            sums[near[row]] = 0.0
    one, reach, half = np.float32(1.0), np.float32(1.0 / (REACH * REACH)), np.float32(0.5)
    for pair in range(len(first)):
        i, j = first[pair], second[pair]
        x, y, z = places[i, 0] - places[j, 0], places[i, 1] - places[j, 1], places[i, 2] - places[j, 2]
        square = x * x + y * y + z * z
        rest = one - square * reach
        if rest > 0:
            rest /= square + half * (plan.core[i] + plan.core[j])
            weight = facing[pair] * rest * rest
            above = x * normals[j, 0] + y * normals[j, 1] + z * normals[j, 2]
            below = -(x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2])
            sums[i, 0] += weight
            sums[j, 0] += weight
            sums[i, 1] += weight * above
            sums[j, 1] += weight * below
            for axis in range(3):
                sums[i, 2 + axis] += weight * normals[j, axis]
                sums[j, 2 + axis] += weight * normals[i, axis]


@_compiled
def _correct(plan: Plan, near: np.ndarray, counts: np.ndarray, sums: np.ndarray, push: np.ndarray) -> bool:
    """Correct the push of each near point by half of what it lacks; returns whether there is any push."""
    pushed = False
    for side in range(len(counts)):
        for row in range(plan.starts[side], plan.starts[side] + counts[side]):
            point = near[row]
            weight = sums[point, 0]
            if weight > 0:
                sure = min(weight / FULL_WEIGHT, 1.0)
                lack = 0.5 * sure * sure * (3.0 - 2.0 * sure) * (plan.want[point] - sums[point, 1] / weight)
                most = plan.allowed[side, plan.points[point]]
                push[point] = min(max(push[point] + lack, 0.0), most)
                pushed |= push[point] > 0
    return pushed


@_compiled
def _spread(
    plan: Plan,
    near: np.ndarray,
    counts: np.ndarray,
    push: np.ndarray,
    sums: np.ndarray,
    shift: np.ndarray,
    side_shift: np.ndarray,
    moved: np.ndarray,
    marked: np.ndarray,
    amount: int,
) -> int:
    """Spread the pushes of points over the vertices around them, into the shift (C, 3) of all.

    A vertex goes as far as the longest push less the slope to it, and in the mean direction of all. Returns
    how many vertices have been moved so far: the first ones of `moved`.
    """
    for row in range(amount):
        shift[moved[row]] = 0.0
    for side in range(len(counts)):
        begin, end = plan.starts[side], plan.starts[side] + counts[side]
        for row in range(begin, end):
            point = near[row]
            if push[point] > 0 and sums[point, 0] > 0:
                x, y, z = sums[point, 2], sums[point, 3], sums[point, 4]
                length = max(np.sqrt(x * x + y * y + z * z), np.float32(1e-12))
                vertex = plan.points[point]
                for entry in range(plan.spread_starts[vertex], plan.spread_starts[vertex + 1]):
                    other = plan.spread_vertices[entry]
                    left = push[point] - plan.slope * plan.spread_lengths[entry]
                    if left > 0 and plan.allowed[side, other] > 0:
                        if not marked[other]:
                            marked[other] = True
                            moved[amount] = other
                            amount += 1
                        side_shift[other, 0] = max(side_shift[other, 0], left)
                        side_shift[other, 1] += left
                        side_shift[other, 2] += left * x / length
                        side_shift[other, 3] += left * y / length
                        side_shift[other, 4] += left * z / length
        for row in range(amount):
            vertex = moved[row]
            if side_shift[vertex, 1] > 0:
                scale = min(side_shift[vertex, 0], plan.allowed[side, vertex]) / side_shift[vertex, 1]
                for axis in range(3):
                    shift[vertex, axis] += scale * side_shift[vertex, 2 + axis]
                side_shift[vertex] = 0.0
    return amount


@_compiled
def _follow(
    corners: np.ndarray,
    plan: Plan,
    near: np.ndarray,
    counts: np.ndarray,
    shift: np.ndarray,
    places: np.ndarray,
) -> None:
    """Move the places of the near points along with their vertices."""
    for side in range(len(counts)):
        for row in range(plan.starts[side], plan.starts[side] + counts[side]):
            point = near[row]
            vertex = plan.points[point]
            for axis in range(3):
                places[point, axis] = corners[vertex, axis] + shift[vertex, axis]


@_compiled
def _move_tips(corners: np.ndarray, plan: Plan, shift: np.ndarray) -> None:
    """Move the tip of each cap by the mean shift of its rim."""
    for tip in range(len(plan.tips)):
        begin, end = plan.rim_starts[tip], plan.rim_starts[tip + 1]
        for axis in range(3):
            total = np.float32(0.0)
            for row in range(begin, end):
                total += shift[plan.rims[row], axis]
            corners[plan.tips[tip], axis] += total / (end - begin)


@_compiled
def thin_out(
    starts: np.ndarray, neighbours: np.ndarray, lengths: np.ndarray, order: np.ndarray, spacing: float
) -> np.ndarray:
    """Choose vertices, the first in order (N,) first, that lie no nearer than spacing, m, along the skin.

    The edges of the skin are a graph in compressed rows. Returns of each vertex (C,) how far away, m, others
    were left out for it; -1 of those that are not chosen.
    """
    vertices = len(starts) - 1
    free, clear = np.zeros(vertices, np.bool_), np.full(vertices, -1.0, np.float32)
    distance, found = np.full(vertices, FAR, np.float32), np.empty(vertices, np.int32)
    free[order] = True
    for source in order:
        if not free[source]:
            continue
        free[source], clear[source] = False, 0.0
        for row in range(_walk(starts, neighbours, lengths, source, spacing, distance, found)):
            if free[found[row]]:
                free[found[row]] = False
                clear[source] = max(clear[source], distance[found[row]])
            distance[found[row]] = FAR
    return clear


@_compiled
def along_skin(
    starts: np.ndarray, neighbours: np.ndarray, lengths: np.ndarray, clear: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find what lies within limit, m, along the skin of each vertex whose clear (C,) m is not negative.

    Returns for Plan: of each vertex its first row, and of all rows the vertices and their lengths beyond
    what is clear.
    """
    vertices = len(starts) - 1
    distance, found = np.full(vertices, FAR, np.float32), np.empty(vertices, np.int32)
    firsts = np.zeros(vertices + 1, np.int32)
    others, ways = np.empty(vertices, np.int32), np.empty(vertices, np.float32)
    total = 0
    for source in range(vertices):
        if clear[source] >= 0:
            count = _walk(starts, neighbours, lengths, source, limit + clear[source], distance, found)
            if total + count > len(others):
                others = np.concatenate((others, np.empty(len(others) + count, np.int32)))
                ways = np.concatenate((ways, np.empty(len(ways) + count, np.float32)))
            for row in range(count):
                vertex = found[row]
                others[total], ways[total] = vertex, max(distance[vertex] - clear[source], 0.0)
                distance[vertex] = FAR
                total += 1
        firsts[source + 1] = total
    return firsts, others[:total].copy(), ways[:total].copy()


@_compiled
def _walk(
    starts: np.ndarray,
    neighbours: np.ndarray,
    lengths: np.ndarray,
    source: int,
    limit: float,
    distance: np.ndarray,
    found: np.ndarray,
) -> int:
    """Dijkstra's search from a vertex: sets the distance of each vertex within limit, m.

    Returns how many it found: the first ones of `found`.
    """
    heap = [(np.float32(0.0), np.int32(source))]
    distance[source], found[0], count = 0.0, source, 1
    while heap:
        gone, vertex = heapq.heappop(heap)
        if gone > distance[vertex]:
            continue
        for edge in range(starts[vertex], starts[vertex + 1]):
            other, way = neighbours[edge], np.float32(gone + lengths[edge])
            if way < limit and way < distance[other]:
                if distance[other] == FAR:
                    found[count] = other
                    count += 1
                distance[other] = way
                heapq.heappush(heap, (way, np.int32(other)))
    return count
