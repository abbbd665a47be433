"""Compiled loops that push the parts of a collider apart, frame after frame on one thread.

A side is one part of a pair against the other; sides 2k and 2k + 1 are pair k. Signed distances are moving
least squares over the points of the other side: its tangent planes, weighted by a smooth function of the
distance and by how much the two skins face each other. So a small change of the pose changes
the result a little; with nearest faces it would jump.
"""

import heapq
from typing import NamedTuple

import numpy as np

from uvcloth.process.compiled import compiled

REACH = 0.08
"""Metres within which points of two parts act on each other; points that are deeper inside stay there."""

FACING = 0.5
"""Cosine between normals below which two skins face each other: the far side of a limb does not count."""

ROUNDS = 5
"""Times that distances are measured and pushes corrected."""

FULL_WEIGHT = 1.0e4
"""Sum of the weights, 1/m4, from which a distance counts in full: that of one facing point 6 cm away."""

LATERAL = 0.03
"""Metres along the wall, from a point to the middle of the wall points that measure it, up to which it has
full weight. At twice this distance its weight is zero, because a tangent plane extends beyond the end of the
wall.
"""

BLOCK = 16
"""Number of neighbouring points with one bounding box, which are skipped together if it is out of reach."""

FAR = np.float32(1.0e9)
"""Metres that stand for no distance, since fast arithmetic has no infinity."""


class Plan(NamedTuple):
    """Points and pairs of a collider of C vertices before it moves, for S sides with K points in all.

    starts: (S + 1,) int32, first point of each side. points: (K,) int32, vertex of each point. want: (K,) m,
    distance that the point keeps from the other part. core: (K,) m2, squared distance within which all points
    of a wall have the same weight. slope: change of a push along the skin, metres for each metre. allowed:
    (S, C) m, longest push of each vertex.

    ring_starts: (C + 1,) int32, first row of each vertex in rings: (R, 2) int32, the other corners of the
    faces around it. spread_starts: (C + 1,) int32, first row of each vertex that is a point in
    spread_vertices: (M,) int32, the vertices that move with it, the nearest first. spread_lengths: (M,) m,
    their distances along the skin.

    tips: (T,) int32, the tips of the caps. rim_starts: (T + 1,) int32, first row of each tip in rims: (E,)
    int32, the vertices around it.
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


@compiled
def open_frames(frames: np.ndarray, plan: Plan) -> None:
    """Push the parts of collider vertices (F, C, 3) float32 m apart, in place."""
    points, vertices = len(plan.points), frames.shape[1]
    near, counts = np.empty(points, np.int32), np.empty(len(plan.starts) - 1, np.int32)
    places, normals = np.empty((points, 3), np.float32), np.empty((points, 3), np.float32)
    sums, push = np.zeros((points, 8), np.float32), np.empty(points, np.float32)
    most = np.zeros(points, np.float32)
    shift, side_shift = np.zeros((vertices, 3), np.float32), np.zeros((vertices, 5), np.float32)
    active, marked = np.empty(vertices, np.int32), np.zeros(vertices, np.bool_)
    for frame in range(len(frames)):
        corners = frames[frame]
        _find_near(corners, plan, near, counts, places)
        _find_normals(corners, plan, near, counts, normals)
        first, second, facing = _find_pairs(plan, near, counts, places, normals)
        if not len(first):
            continue
        push[:], most[:] = 0.0, 0.0
        amount = 0
        for each in range(ROUNDS):
            _measure(plan, near, counts, places, normals, first, second, facing, sums)
            pushed = _correct(plan, near, counts, sums, each == 0, most, push)
            if each == 0 and not pushed:
                break
            amount = _spread(plan, near, counts, push, sums, shift, side_shift, active, marked, amount)
            _follow(corners, plan, near, counts, shift, places)
        for row in range(amount):
            vertex = active[row]
            for axis in range(3):
                corners[vertex, axis] += shift[vertex, axis]
        _move_tips(corners, plan, shift)
        for row in range(amount):
            shift[active[row]] = 0.0
            marked[active[row]] = False


@compiled
def distances(corners: np.ndarray, plan: Plan) -> np.ndarray:
    """Signed distances (K,) m of the points of collider vertices (C, 3) to the other parts, else FAR."""
    points = len(plan.points)
    near, counts = np.empty(points, np.int32), np.empty(len(plan.starts) - 1, np.int32)
    places, normals = np.empty((points, 3), np.float32), np.empty((points, 3), np.float32)
    sums, signed = np.zeros((points, 8), np.float32), np.full(points, FAR, np.float32)
    _find_near(corners, plan, near, counts, places)
    _find_normals(corners, plan, near, counts, normals)
    first, second, facing = _find_pairs(plan, near, counts, places, normals)
    _measure(plan, near, counts, places, normals, first, second, facing, sums)
    for side in range(len(counts)):
        for row in range(plan.starts[side], plan.starts[side] + counts[side]):
            point = near[row]
            if sums[point, 0] > 0:
                signed[point] = sums[point, 1] / sums[point, 0]
    return signed


@compiled
def _find_near(
    corners: np.ndarray, plan: Plan, near: np.ndarray, counts: np.ndarray, places: np.ndarray
) -> None:
    """Find the points of each side that are within reach of the box around the other side, and their places.

    The near points of a side are stored in `near` from the side's first point on.
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
                for axis in range(3):
                    places[point, axis] = corners[plan.points[point], axis]
                count += 1
        counts[side] = count


@compiled
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


@compiled
def _find_pairs(
    plan: Plan, near: np.ndarray, counts: np.ndarray, places: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the points of the two sides of each pair that are within reach and face each other.

    Returns the two points of each pair, and a weight from 0 to 1 by which they face each other.
    """
    most = 0
    for side in range(0, len(counts), 2):
        most += counts[side] * counts[side + 1]
    first, second = np.empty(most, np.int32), np.empty(most, np.int32)
    facing, total = np.empty(most, np.float32), 0
    reach, cosine, scale = np.float32(REACH * REACH), np.float32(FACING), np.float32(1.0 / (1.0 + FACING))
    for side in range(0, len(counts), 2):
        begin = plan.starts[side + 1]
        end = begin + counts[side + 1]
        low, high = _block_boxes(near[begin:end], places)
        for row in range(plan.starts[side], plan.starts[side] + counts[side]):
            i = near[row]
            px, py, pz = places[i, 0], places[i, 1], places[i, 2]
            nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
            for block in range(len(low)):
                x = max(low[block, 0] - px, px - high[block, 0], np.float32(0.0))
                y = max(low[block, 1] - py, py - high[block, 1], np.float32(0.0))
                z = max(low[block, 2] - pz, pz - high[block, 2], np.float32(0.0))
                if x * x + y * y + z * z >= reach:
                    continue
                for column in range(begin + block * BLOCK, min(begin + (block + 1) * BLOCK, end)):
                    j = near[column]
                    x, y, z = places[j, 0] - px, places[j, 1] - py, places[j, 2] - pz
                    if x * x + y * y + z * z < reach:
                        along = nx * normals[j, 0] + ny * normals[j, 1] + nz * normals[j, 2]
                        against = (cosine - along) * scale
                        if against > 0:
                            first[total], second[total], facing[total] = i, j, against * against
                            total += 1
    return first[:total], second[:total], facing[:total]


@compiled
def _block_boxes(near: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the boxes around every BLOCK of near points (N,): their corners, (blocks, 3) each."""
    blocks = (len(near) + BLOCK - 1) // BLOCK
    low, high = np.full((blocks, 3), FAR, np.float32), np.full((blocks, 3), -FAR, np.float32)
    for row in range(len(near)):
        for axis in range(3):
            place = places[near[row], axis]
            low[row // BLOCK, axis] = min(low[row // BLOCK, axis], place)
            high[row // BLOCK, axis] = max(high[row // BLOCK, axis], place)
    return low, high


@compiled
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
    """Sum up, for each near point, the weights and the weighted distances to planes, normals, and offsets
    from the wall points.
    """
    for side in range(len(counts)):
        for row in range(plan.starts[side], plan.starts[side] + counts[side]):
            for term in range(8):
                sums[near[row], term] = 0.0
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    reach, pair = np.float32(1.0 / (REACH * REACH)), 0
    while pair < len(first):
        i = first[pair]
        px, py, pz = places[i, 0], places[i, 1], places[i, 2]
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        core, sum_weight, sum_above = plan.core[i], zero, zero
        wall_x, wall_y, wall_z, way_x, way_y, way_z = zero, zero, zero, zero, zero, zero
        while pair < len(first) and first[pair] == i:
            j = second[pair]
            x, y, z = px - places[j, 0], py - places[j, 1], pz - places[j, 2]
            square = x * x + y * y + z * z
            rest = one - square * reach
            if rest > 0:
                rest /= square + half * (core + plan.core[j])
                weight = facing[pair] * rest * rest
                mx, my, mz = weight * normals[j, 0], weight * normals[j, 1], weight * normals[j, 2]
                sum_weight += weight
                sum_above += x * mx + y * my + z * mz
                wall_x, wall_y, wall_z = wall_x + mx, wall_y + my, wall_z + mz
                x, y, z = weight * x, weight * y, weight * z
                way_x, way_y, way_z = way_x + x, way_y + y, way_z + z
                sums[j, 0] += weight
                sums[j, 1] -= x * nx + y * ny + z * nz
                sums[j, 2] += weight * nx
                sums[j, 3] += weight * ny
                sums[j, 4] += weight * nz
                sums[j, 5] -= x
                sums[j, 6] -= y
                sums[j, 7] -= z
            pair += 1
        sums[i, 0] += sum_weight
        sums[i, 1] += sum_above
        sums[i, 2] += wall_x
        sums[i, 3] += wall_y
        sums[i, 4] += wall_z
        sums[i, 5] += way_x
        sums[i, 6] += way_y
        sums[i, 7] += way_z


@compiled
def _lateral_distance(sums: np.ndarray, point: int) -> float:
    """Distance, m, along a wall from a point to the middle of the points that measure it."""
    along, square, length = 0.0, 0.0, 0.0
    for axis in range(3):
        along += sums[point, 5 + axis] * sums[point, 2 + axis]
        square += sums[point, 5 + axis] * sums[point, 5 + axis]
        length += sums[point, 2 + axis] * sums[point, 2 + axis]
    return np.sqrt(max(square - along * along / max(length, 1e-12), 0.0)) / sums[point, 0]


@compiled
def _smooth_step(value: float) -> float:
    """0 up to 0, 1 from 1 on, without a kink."""
    value = min(max(value, 0.0), 1.0)
    return value * value * (3.0 - 2.0 * value)


@compiled
def _correct(
    plan: Plan,
    near: np.ndarray,
    counts: np.ndarray,
    sums: np.ndarray,
    first: bool,
    most: np.ndarray,
    push: np.ndarray,
) -> bool:
    """Correct the push of each near point by half of its missing distance.

    The sum is at most the missing distance of the first round. Returns whether there is any push.
    """
    pushed = False
    for side in range(len(counts)):
        for row in range(plan.starts[side], plan.starts[side] + counts[side]):
            point = near[row]
            weight = sums[point, 0]
            if weight > 0:
                lack = plan.want[point] - sums[point, 1] / weight
                if lack <= 0 and push[point] <= 0:
                    continue
                lack *= _smooth_step(weight / FULL_WEIGHT) * _smooth_step(
                    2.0 - _lateral_distance(sums, point) / LATERAL
                )
                if first:
                    most[point] = min(max(lack, 0.0), plan.allowed[side, plan.points[point]])
                push[point] = min(max(push[point] + 0.5 * lack, 0.0), most[point])
                pushed |= push[point] > 0
    return pushed


@compiled
def _spread(
    plan: Plan,
    near: np.ndarray,
    counts: np.ndarray,
    push: np.ndarray,
    sums: np.ndarray,
    shift: np.ndarray,
    side_shift: np.ndarray,
    active: np.ndarray,
    marked: np.ndarray,
    amount: int,
) -> int:
    """Spread the pushes of points over the vertices around them, into the shift (C, 3) of all.

    A vertex moves by the largest push, reduced by the slope along the skin, in the mean direction of all
    pushes. Returns the number of vertices with a shift so far, which are the first ones of `active`.
    """
    for row in range(amount):
        shift[active[row]] = 0.0
    for side in range(len(counts)):
        pushed = False
        for row in range(plan.starts[side], plan.starts[side] + counts[side]):
            point = near[row]
            if push[point] > 0 and sums[point, 0] > 0:
                x, y, z = sums[point, 2], sums[point, 3], sums[point, 4]
                length = max(np.sqrt(x * x + y * y + z * z), np.float32(1e-12))
                x, y, z = x / length, y / length, z / length
                vertex, pushed = plan.points[point], True
                for entry in range(plan.spread_starts[vertex], plan.spread_starts[vertex + 1]):
                    other = plan.spread_vertices[entry]
                    left = push[point] - plan.slope * plan.spread_lengths[entry]
                    if left <= 0:
                        break
                    if plan.allowed[side, other] > 0:
                        if not marked[other]:
                            marked[other] = True
                            active[amount] = other
                            amount += 1
                        side_shift[other, 0] = max(side_shift[other, 0], left)
                        side_shift[other, 1] += left
                        side_shift[other, 2] += left * x
                        side_shift[other, 3] += left * y
                        side_shift[other, 4] += left * z
        for row in range(amount if pushed else 0):
            vertex = active[row]
            if side_shift[vertex, 1] > 0:
                scale = min(side_shift[vertex, 0], plan.allowed[side, vertex]) / side_shift[vertex, 1]
                for axis in range(3):
                    shift[vertex, axis] += scale * side_shift[vertex, 2 + axis]
                side_shift[vertex] = 0.0
    return amount


@compiled
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


@compiled
def _move_tips(corners: np.ndarray, plan: Plan, shift: np.ndarray) -> None:
    """Move the tip of each cap by the mean shift of its rim."""
    for tip in range(len(plan.tips)):
        begin, end = plan.rim_starts[tip], plan.rim_starts[tip + 1]
        for axis in range(3):
            total = np.float32(0.0)
            for row in range(begin, end):
                total += shift[plan.rims[row], axis]
            corners[plan.tips[tip], axis] += total / (end - begin)


@compiled
def thin_out(
    starts: np.ndarray, neighbours: np.ndarray, lengths: np.ndarray, order: np.ndarray, spacing: float
) -> np.ndarray:
    """Choose vertices, in a given order (N,), that are at least spacing, m, apart along the skin.

    The edges of the skin are a graph in compressed rows. Returns (C,) m: for each chosen vertex the distance
    within which others were left out for it, -1 for all others.
    """
    vertices = len(starts) - 1
    free, clear = np.zeros(vertices, np.bool_), np.full(vertices, -1.0, np.float32)
    distance, region = np.full(vertices, FAR, np.float32), np.empty(vertices, np.int32)
    free[order] = True
    for source in order:
        if not free[source]:
            continue
        free[source], clear[source] = False, 0.0
        for row in range(_walk(starts, neighbours, lengths, source, spacing, distance, region)):
            if free[region[row]]:
                free[region[row]] = False
                clear[source] = max(clear[source], distance[region[row]])
            distance[region[row]] = FAR
    return clear


@compiled
def along_skin(
    starts: np.ndarray, neighbours: np.ndarray, lengths: np.ndarray, clear: np.ndarray, limit: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the vertices within limit, m, along the skin of each vertex whose clear (C,) m is not negative.

    Returns the spread of `Plan`: the first row of each vertex, the vertices of all rows, the nearest first,
    and their distances less that of `clear`.
    """
    vertices = len(starts) - 1
    distance, region = np.full(vertices, FAR, np.float32), np.empty(vertices, np.int32)
    firsts = np.zeros(vertices + 1, np.int32)
    others, ways = np.empty(vertices, np.int32), np.empty(vertices, np.float32)
    total = 0
    for source in range(vertices):
        if clear[source] >= 0:
            count = _walk(starts, neighbours, lengths, source, limit + clear[source], distance, region)
            if total + count > len(others):
                others = np.concatenate((others, np.empty(len(others) + count, np.int32)))
                ways = np.concatenate((ways, np.empty(len(ways) + count, np.float32)))
            reached = region[:count]
            for vertex in reached[np.argsort(distance[reached])]:
                others[total], ways[total] = vertex, max(distance[vertex] - clear[source], 0.0)
                distance[vertex] = FAR
                total += 1
        firsts[source + 1] = total
    return firsts, others[:total].copy(), ways[:total].copy()


@compiled
def _walk(
    starts: np.ndarray,
    neighbours: np.ndarray,
    lengths: np.ndarray,
    source: int,
    limit: float,
    distance: np.ndarray,
    region: np.ndarray,
) -> int:
    """Dijkstra's search from a vertex: sets the distance of each vertex within limit, m.

    Returns their number; they are the first ones of `region`.
    """
    heap = [(np.float32(0.0), np.int32(source))]
    distance[source], region[0], count = 0.0, source, 1
    while heap:
        gone, vertex = heapq.heappop(heap)
        if gone > distance[vertex]:
            continue
        for edge in range(starts[vertex], starts[vertex + 1]):
            other, way = neighbours[edge], np.float32(gone + lengths[edge])
            if way < limit and way < distance[other]:
                if distance[other] == FAR:
                    region[count] = other
                    count += 1
                distance[other] = way
                heapq.heappush(heap, (way, np.int32(other)))
    return count
