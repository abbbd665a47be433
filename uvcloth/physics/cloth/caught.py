"""Cloth that a limb takes into another one: mocap moves forearms through knees.

There a sleeve would push the trousers off the leg. Where it is inside, the two are not in contact.
"""

import numpy as np

from uvcloth.physics.cloth.cloth import Sheet
from uvcloth.physics.cloth.moving_body import Body, corners, fit_patches
from uvcloth.physics.cloth.self_contact import Pairs
from uvcloth.physics.cloth.tree import DEPTH, box_distance, closest_face
from uvcloth.physics.cloth.triangles import closest_barycentrics, weighted
from uvcloth.physics.cloth.vectors import ZERO, Array, Vector, cross, dot, load, sub
from uvcloth.process.compiled import borrowing, compiled, inlined

DEEPEST = np.float32(0.1)
"""Metres under the skin within which cloth is found: no limb is twice as thick."""


@compiled
def find_caught(body: Body, points: Array, positions: Array) -> Array:
    """Find the parts of a body at (V, 3) m that cloth at (N, 3) m is inside, of those that it may cross.

    Returns a mask (K, N), bool.
    """
    caught = np.zeros(body.crossed.shape, np.bool_)
    if body.crossed.any():
        boxes = np.empty((len(body.tree.ranges), 6), np.float32)
        fit_patches(body, points, boxes)
        fitted = np.zeros(len(body.patches.roots), np.int32)
        stack, distances = np.empty(DEPTH, np.int32), np.empty(DEPTH, np.float32)
        _find_inside(body, points, positions, boxes, fitted, stack, distances, caught)
    return caught


@borrowing
def _find_inside(
    body: Body,
    points: Array,
    positions: Array,
    boxes: Array,
    fitted: Array,
    stack: Array,
    distances: Array,
    caught: Array,
) -> None:
    for part in range(len(caught)):
        root = body.tree.roots[part]
        for vertex in range(len(positions)):
            point = load(positions, vertex)
            if not body.crossed[part, vertex] or box_distance(boxes, root, point) > ZERO:
                continue
            face, _ = closest_face(
                body.tree,
                body.patches,
                root,
                boxes,
                fitted,
                1,
                body.faces,
                points,
                point,
                DEEPEST,
                -1,
                -1,
                stack,
                distances,
            )
            caught[part, vertex] = face >= 0 and _is_beneath(body, points, face, point)


@inlined
def _is_beneath(body: Body, points: Array, face: int, point: Vector) -> bool:
    a, b, c = corners(body.faces, points, face)
    away = sub(point, weighted(closest_barycentrics(point, a, b, c), a, b, c))
    return bool(dot(away, cross(sub(b, a), sub(c, a))) < ZERO)


@compiled
def without_caught(pairs: Pairs, sheet: Sheet, body: Body, caught: Array) -> Pairs:
    """Pairs but for those of cloth inside a part, (K, N) bool, that the other cloth touches."""
    if not caught.any():
        return pairs
    points, edges = np.ones(len(pairs.points), np.bool_), np.ones(len(pairs.edges), np.bool_)
    for k in range(len(points)):
        for corner in sheet.faces[pairs.points[k, 1]]:
            points[k] &= not _pass(body, caught, pairs.points[k, 0], corner)
    for k in range(len(edges)):
        for one in sheet.edges[pairs.edges[k, 0]]:
            for other in sheet.edges[pairs.edges[k, 1]]:
                edges[k] &= not _pass(body, caught, one, other)
    return Pairs(pairs.points[points], pairs.sides[points], pairs.edges[edges], pairs.directions[edges])


@inlined
def _pass(body: Body, caught: Array, one: int, other: int) -> bool:
    """True for two vertices of which one is inside a part that the other touches."""
    for part in range(len(caught)):
        if (caught[part, one] and body.touches[part, other]) or (
            caught[part, other] and body.touches[part, one]
        ):
            return True
    return False
