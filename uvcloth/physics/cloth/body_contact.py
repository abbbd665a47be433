"""Contact of cloth with a moving body: closest faces of its parts, and Coulomb friction on them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uvcloth.physics.cloth.tree import (
    BODY_LEAF,
    DEPTH,
    Tree,
    build_tree,
    closest_face,
    neighbour_faces,
    refit,
)
from uvcloth.physics.cloth.triangles import closest_barycentrics, weighted
from uvcloth.physics.cloth.vectors import (
    ONE,
    TWO,
    ZERO,
    Array,
    Number,
    Vector,
    add,
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
from uvcloth.process.compiled import compiled, inlined

STEPS = 4
"""Neighbouring faces that a contact walks over in a substep at most."""

ON_SURFACE = np.float32(1e-6)
"""Metres from a face below which its normal counts, and not the direction to it."""

SHALLOW = np.float32(1e-3)
"""Metres of depth that are removed at once."""

PUSH_SPEED = np.float32(1.0)
"""Speed, m/s, at which cloth is moved out of a greater depth, so that it does not jump."""

ALERT_SPEED = np.float32(0.5)
"""Speed, m/s, that a contact may gain before it is looked at again."""


class Body(NamedTuple):
    """Parts of a body that cloth meets, each a closed surface, all over the same V vertices.

    faces: (F, 3) int32, part after part. neighbours: (F, 3) int32, across edge i to i + 1. tree: one root per
    part. touches: (K, N) bool, the parts that may touch each vertex of the cloth.
    """

    faces: NDArray[np.int32]
    neighbours: NDArray[np.int32]
    tree: Tree
    touches: NDArray[np.bool_]


def make_body(vertices: NDArray, parts: Sequence[NDArray], touches: NDArray) -> Body:
    """Make the body of its parts, faces (F, 3) each, at vertices (V, 3) m. touches: (K, N) bool."""
    faces = np.concatenate([np.zeros((0, 3)), *parts]).astype(np.int32)
    neighbours, first = [np.zeros((0, 3))], 0
    for part in parts:
        own = neighbour_faces(np.asarray(part))
        neighbours.append(np.where(own < 0, -1, own + first))
        first += len(part)
    return Body(
        faces=faces,
        neighbours=np.concatenate(neighbours).astype(np.int32),
        tree=build_tree(np.asarray(vertices, np.float32), faces, [len(part) for part in parts], BODY_LEAF),
        touches=np.ascontiguousarray(touches, np.bool_),
    )


class Contacts(NamedTuple):
    """Vertices near the body, with the face that each is closest to.

    vertices, faces: (C,) int32. wait: (C,) int32, substeps until the contact is looked at again.
    """

    vertices: NDArray[np.int32]
    faces: NDArray[np.int32]
    wait: NDArray[np.int32]


@compiled
def find_contacts(
    body: Body, points: Array, normals: Array, boxes: Array, positions: Array, reach: Number, hints: Array
) -> Contacts:
    """Find the closest face of every part that a vertex may touch, within reach, m.

    points: (V, 3) m of the body now. normals: (V, 3), boxes: (T, 6) are filled. hints: (K, N) int32, the
    faces found last, -1 for none, are renewed.
    """
    _vertex_normals(body.faces, points, normals)
    refit(body.tree, body.faces, points, boxes)
    parts, count = body.touches.shape
    vertices, faces = np.empty(parts * count, np.int32), np.empty(parts * count, np.int32)
    stack = np.empty(DEPTH, np.int32)
    found = 0
    for vertex in range(count):
        point = load(positions, vertex)
        for part in range(parts):
            if body.touches[part, vertex]:
                face = closest_face(
                    body.tree,
                    body.tree.roots[part],
                    boxes,
                    body.faces,
                    points,
                    point,
                    reach,
                    hints[part, vertex],
                    stack,
                )
                hints[part, vertex] = face
                if face >= 0:
                    vertices[found], faces[found] = vertex, face
                    found += 1
    return Contacts(vertices[:found].copy(), faces[:found].copy(), np.zeros(found, np.int32))


@compiled
def resolve_contacts(
    contacts: Contacts,
    body: Body,
    start: Array,
    end: Array,
    share: Number,
    normals: Array,
    positions: Array,
    velocities: Array,
    thickness: Array,
    radius: Number,
    friction: Number,
    step: Number,
    seconds: Number,
) -> None:
    """Move vertices out of the body to a distance of radius + thickness, m, without a bounce, with friction.

    start, end: (V, 3) m, the body before and after the frame of `seconds`; it is at a share of the way.
    step: s.
    """
    rate = ONE / seconds
    for k in range(len(contacts.vertices)):
        if contacts.wait[k] > 0:
            contacts.wait[k] -= 1
            continue
        vertex, face = contacts.vertices[k], contacts.faces[k]
        point = load(positions, vertex)
        weights, away = _nearby(body.faces, start, end, share, face, point)
        for _ in range(STEPS - 1):
            across = -1
            if weights[0] <= ZERO:
                across = body.neighbours[face, 1]
            elif weights[1] <= ZERO:
                across = body.neighbours[face, 2]
            elif weights[2] <= ZERO:
                across = body.neighbours[face, 0]
            if across < 0:
                break
            other, farther = _nearby(body.faces, start, end, share, across, point)
            if dot(farther, farther) >= dot(away, away) - np.float32(1e-12):
                break
            face, weights, away = across, other, farther
        contacts.faces[k] = face
        a, b, c = body.faces[face, 0], body.faces[face, 1], body.faces[face, 2]
        outwards = weighted(weights, load(normals, a), load(normals, b), load(normals, c))
        side = ONE if dot(away, outwards) >= ZERO else -ONE
        distance = length(away)
        normal = scale(side / distance, away) if distance > ON_SURFACE else unit(outwards)
        gap = side * distance - radius - thickness[vertex]
        advance = weighted(
            weights,
            sub(load(end, a), load(start, a)),
            sub(load(end, b), load(start, b)),
            sub(load(end, c), load(start, c)),
        )
        surface = scale(rate, advance)
        slip = sub(load(velocities, vertex), surface)
        if gap >= ZERO:
            contacts.wait[k] = int(gap / (TWO * step * (length(slip) + ALERT_SPEED)))
            continue
        approach = dot(slip, normal)
        along = sub(slip, scale(approach, normal))
        stopped = max(-approach, ZERO)
        # What the body came nearer in this substep is taken back whatever its speed.
        depth = -gap
        pushed = depth if depth < SHALLOW else min(depth, (PUSH_SPEED + length(surface)) * step)
        store(positions, vertex, combine(ONE, point, pushed, normal))
        speed = length(along)
        kept = ONE - friction * stopped / speed if speed > friction * stopped else ZERO
        slip = combine(kept, along, approach + stopped, normal)
        store(velocities, vertex, add(surface, slip))


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


@compiled
def _vertex_normals(faces: Array, points: Array, normals: Array) -> None:
    normals[:] = ZERO
    for face in range(len(faces)):
        a, b, c = load(points, faces[face, 0]), load(points, faces[face, 1]), load(points, faces[face, 2])
        normal = cross(sub(b, a), sub(c, a))
        for corner in range(3):
            vertex = faces[face, corner]
            store(normals, vertex, add(load(normals, vertex), normal))
    for vertex in range(len(normals)):
        store(normals, vertex, unit(load(normals, vertex)))
