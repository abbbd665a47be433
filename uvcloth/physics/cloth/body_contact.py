"""Contact of cloth with a moving body: closest faces of its parts, and Coulomb friction on them."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uvcloth.physics.cloth.tree import (
    BODY_LEAF,
    DEPTH,
    Patches,
    Tree,
    build_tree,
    closest_face,
    find_patches,
    join_boxes,
    neighbour_faces,
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
from uvcloth.process.compiled import borrowing, compiled, inlined

STEPS = 4
"""Neighbouring faces that a contact walks over in a substep at most."""

ON_SURFACE = np.float32(1e-6)
"""Metres from a face below which its normal counts, and not the direction to it."""

SHALLOW = np.float32(1e-3)
"""Metres of depth that are removed at once."""

PUSH_SPEED = np.float32(1.0)
"""Speed, m/s, at which cloth is moved out of a greater depth, so that it does not jump."""

ALERT_SPEED = np.float32(0.5)
"""Speed, m/s, that a contact may gain before it is searched again."""

BLOCK = 64
"""Normals that are computed side by side."""

PATCH = 64
"""Faces in a patch of a body at most, whose boxes are fitted where cloth is near."""

ROUNDED = np.float32(1e-5)
"""Metres by which distances may be off by rounding."""


class Body(NamedTuple):
    """Parts of a body that cloth collides with, each a closed surface, all over the same V vertices.

    faces: (F, 3) int32, part after part. neighbours: (F, 3) int32, across edge i to i + 1. tree: one root per
    part. patches: of the tree; patch_parts: (P,) int32, which part each is of. around: the faces around each
    vertex, in order, from around_starts, (V + 1,), on. touches: (K, N) bool, the parts that may touch each
    vertex of the cloth.
    """

    faces: NDArray[np.int32]
    neighbours: NDArray[np.int32]
    tree: Tree
    patches: Patches
    patch_parts: NDArray[np.int32]
    around: NDArray[np.int32]
    around_starts: NDArray[np.int32]
    touches: NDArray[np.bool_]


def make_body(vertices: NDArray, parts: Sequence[NDArray], touches: NDArray) -> Body:
    """Make the body of its parts, faces (F, 3) each, at vertices (V, 3) m. touches: (K, N) bool."""
    faces = np.concatenate([np.zeros((0, 3)), *parts]).astype(np.int32)
    neighbours, first = [np.zeros((0, 3))], 0
    for part in parts:
        own = neighbour_faces(np.asarray(part))
        neighbours.append(np.where(own < 0, -1, own + first))
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
    )


class Contacts(NamedTuple):
    """Vertices near the body, with the face that each is closest to.

    vertices, faces: (C,) int32. wait: (C,) int32, substeps until the contact is looked at again.
    """

    vertices: NDArray[np.int32]
    faces: NDArray[np.int32]
    wait: NDArray[np.int32]


class Passage(NamedTuple):
    """The body on its way through a frame, and what the searches of the frame know.

    start, end: (V, 3) m before and after the frame. points: (V, 3) m at the last search. normals: (V, 3)
    there, of the vertices for which `known`, (V,) int32, is the number of that search. face_normals:
    (F, 3) m2, face_known: (F,), the same of the faces. units: a block in which they are computed. boxes:
    (T, 6) of the tree, in patches for which `fitted`, (P,) int32, is it. hints: (K, N) int32, the face of
    each part that was found last for each vertex of the cloth, -1 for none; guesses: those of the frame
    before. clear: (K, N) m, within which there was none. ways: (K,) m that a part moves in the frame at most.
    cloth: (N, 3) m at the last search. share: (1,) of the way at which it was. searches: (1,) int32, how many
    there were.
    """

    start: NDArray[np.float32]
    end: NDArray[np.float32]
    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    known: NDArray[np.int32]
    face_normals: NDArray[np.float32]
    face_known: NDArray[np.int32]
    units: NDArray[np.float32]
    boxes: NDArray[np.float32]
    fitted: NDArray[np.int32]
    hints: NDArray[np.int32]
    guesses: NDArray[np.int32]
    clear: NDArray[np.float32]
    ways: NDArray[np.float32]
    cloth: NDArray[np.float32]
    share: NDArray[np.float32]
    searches: NDArray[np.int32]


@compiled
def begin_passage(body: Body, start: Array, end: Array, positions: Array, guesses: Array) -> Passage:
    """Begin a frame of a body at (V, 3) m before and after it, and of cloth at (N, 3) m.

    guesses: (K, N) int32, the hints at the end of the frame before, or none: what is found is the same.
    """
    ways = np.zeros(len(body.touches), np.float32)
    patches = body.patches
    for patch in range(len(patches.roots)):
        most = ZERO
        for k in range(patches.vertex_starts[patch], patches.vertex_starts[patch + 1]):
            way = sub(load(end, patches.vertices[k]), load(start, patches.vertices[k]))
            most = max(most, dot(way, way))
        part = body.patch_parts[patch]
        ways[part] = max(ways[part], math.sqrt(most))
    return Passage(
        start,
        end,
        np.empty_like(start),
        np.empty_like(start),
        np.zeros(len(start), np.int32),
        np.empty(body.faces.shape, np.float32),
        np.zeros(len(body.faces), np.int32),
        np.zeros((BLOCK + len(start) % BLOCK, 3), np.float32),
        np.empty((len(body.tree.ranges), 6), np.float32),
        np.zeros(len(patches.roots), np.int32),
        np.full(body.touches.shape, -1, np.int32),
        guesses if guesses.size > 0 else np.full(body.touches.shape, -1, np.int32),
        np.zeros(body.touches.shape, np.float32),
        ways,
        positions.copy(),
        np.zeros(1, np.float32),
        np.zeros(1, np.int32),
    )


@compiled
def find_contacts(body: Body, passage: Passage, share: Number, positions: Array, reach: Number) -> Contacts:
    """Find the closest face of every part that a vertex may touch, within reach, m.

    The body is at a share of its way. A part is not searched for a vertex to which it cannot have come near
    since the last search.
    """
    passage.points[:] = (ONE - share) * passage.start + share * passage.end
    _fit_patches(body, passage.points, passage.boxes)
    vertices, faces = np.empty(body.touches.size, np.int32), np.empty(body.touches.size, np.int32)
    stack, distances = np.empty(DEPTH, np.int32), np.empty(DEPTH, np.float32)
    found = _search(body, passage, share, positions, reach, stack, distances, vertices, faces)
    return Contacts(vertices[:found].copy(), faces[:found].copy(), np.zeros(found, np.int32))


@borrowing
def _search(
    body: Body,
    passage: Passage,
    share: Number,
    positions: Array,
    reach: Number,
    stack: Array,
    distances: Array,
    vertices: Array,
    faces: Array,
) -> int:
    """Search as `find_contacts` says, to the beginning of vertices and faces (K N,); returns how many."""
    passage.searches[0] += 1
    since = share - passage.share[0]
    passage.share[0] = share
    parts, count = body.touches.shape
    contacts = 0
    for vertex in range(count):
        point = load(positions, vertex)
        way = length(sub(point, load(passage.cloth, vertex)))
        for part in range(parts):
            if not body.touches[part, vertex]:
                continue
            clear = passage.clear[part, vertex] - (way + since * passage.ways[part] + ROUNDED)
            if clear <= reach + ROUNDED:
                face, beyond = closest_face(
                    body.tree,
                    body.patches,
                    body.tree.roots[part],
                    passage.boxes,
                    passage.fitted,
                    passage.searches[0],
                    body.faces,
                    passage.points,
                    point,
                    reach,
                    passage.hints[part, vertex],
                    passage.guesses[part, vertex] if passage.searches[0] == 1 else -1,
                    stack,
                    distances,
                )
                passage.hints[part, vertex] = face
                if face >= 0:
                    vertices[contacts], faces[contacts] = vertex, face
                    contacts += 1
                clear = math.sqrt(beyond) if face < 0 else ZERO
            passage.clear[part, vertex] = clear
        store(passage.cloth, vertex, point)
    return contacts


@borrowing
def _fit_patches(body: Body, points: Array, boxes: Array) -> None:
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
    """Find the normals of a face's corners at the last search, where they are not known.

    They are rounded as in loops over all faces and all vertices: those of the faces around are kept, since a
    sum in registers rounds otherwise, and those of the vertices are made units in a block, in whose end are
    the last vertices, with which the registers are not filled.
    """
    search, units = passage.searches[0], passage.units
    tail = len(passage.normals) - len(units)
    unknown = False
    for corner in range(3):
        vertex = body.faces[face, corner]
        if passage.known[vertex] == search:
            continue
        unknown = True
        total = ZERO, ZERO, ZERO
        for k in range(body.around_starts[vertex], body.around_starts[vertex + 1]):
            other = body.around[k]
            if passage.face_known[other] != search:
                passage.face_known[other] = search
                a = load(passage.points, body.faces[other, 0])
                b = load(passage.points, body.faces[other, 1])
                c = load(passage.points, body.faces[other, 2])
                store(passage.face_normals, other, cross(sub(b, a), sub(c, a)))
            total = add(total, load(passage.face_normals, other))
        store(units, vertex - tail if vertex - tail >= BLOCK else corner, total)
    if unknown:
        _make_units(units)
        for corner in range(3):
            vertex = body.faces[face, corner]
            if passage.known[vertex] != search:
                passage.known[vertex] = search
                store(
                    passage.normals, vertex, load(units, vertex - tail if vertex - tail >= BLOCK else corner)
                )


@borrowing
def _make_units(vectors: Array) -> None:
    for k in range(len(vectors)):
        store(vectors, k, unit(load(vectors, k)))


@borrowing
def resolve_contacts(
    contacts: Contacts,
    body: Body,
    passage: Passage,
    share: Number,
    positions: Array,
    velocities: Array,
    thickness: Array,
    radius: Number,
    friction: Number,
    step: Number,
    seconds: Number,
) -> None:
    """Move vertices out of the body to a distance of radius + thickness, m, without a bounce, with friction.

    The body is at a share of its way through the frame of `seconds`. step: s.
    """
    start, end, normals = passage.start, passage.end, passage.normals
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
        find_normals(body, passage, face)
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
        # The approach of the body in this substep is undone at any speed.
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
