"""Contact of cloth with a moving body: closest faces of its parts, and Coulomb friction on them."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uvcloth.physics.cloth.moving_body import (
    ROUNDED,
    Body,
    Passage,
    approach,
    closing,
    corners,
    find_normals,
    fit_patches,
    walk,
)
from uvcloth.physics.cloth.tree import DEPTH, closest_face
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

STEPS, FOLLOWED = 3, 8
"""Neighbouring faces that a vertex is followed over at most, in a substep and from search to search."""

ON_SURFACE = np.float32(1e-6)
"""Metres from a face below which its normal counts, and not the direction to it."""

SHALLOW = np.float32(1e-3)
"""Metres of depth that are removed at once."""

PUSH_SPEED = np.float32(1.0)
"""Speed, m/s, at which cloth is moved out of a greater depth, so that it does not jump."""

ALERT_SPEED = np.float32(0.5)
"""Speed, m/s, that a contact may gain before it is searched again."""

CLOSE = np.float32(0.01)
"""Metres from the body up to which a vertex is followed: farther off, a face elsewhere may be closer."""

SPARE = np.float32(1.5)
"""Factor on the speed of a vertex, which may grow, for its way until the next search."""

LONGEST = np.float32(1.0 / 60.0)
"""Seconds after a search of all faces in which a vertex is followed within the whole reach."""

SLIDE = np.float32(1e-3)
"""Metres that a vertex moves past the body before its closest point is found again."""


class Contacts(NamedTuple):
    """Vertices near the body, each with the plane that the body is for it.

    vertices, faces: (C,) int32, the closest face. wait: (C,) int32, substeps until the contact is looked at
    again. points: (C, 3) m, the closest points of the body before the frame; ways: (C, 3) m, their motion
    in it. normals: (C, 3). slide: (C,) m that the vertex may move past the point until it is searched again.
    """

    vertices: NDArray[np.int32]
    faces: NDArray[np.int32]
    wait: NDArray[np.int32]
    points: NDArray[np.float32]
    ways: NDArray[np.float32]
    normals: NDArray[np.float32]
    slide: NDArray[np.float32]


class Watch(NamedTuple):
    """Motion and distances of cloth by which a search decides what may touch until the next one.

    velocities: (N, 3) m/s. near: (N,) m, distance from which a vertex touches. interval: share of the frame
    until the next search. seconds: of the frame. reach: m, how far outside and how deep in the body a face is
    found. followed: m outside the body up to which a vertex that had a face is followed over neighbouring
    faces, longer than LONGEST after a search of all of them.
    """

    velocities: NDArray[np.float32]
    near: NDArray[np.float32]
    interval: np.float32
    seconds: np.float32
    reach: np.float32
    followed: np.float32


@inlined
def no_contacts() -> Contacts:
    """No vertices near a body."""
    none = np.zeros(0, np.int32)
    return _contacts(none, none)


@compiled
def find_contacts(body: Body, passage: Passage, share: Number, positions: Array, watch: Watch) -> Contacts:
    """Find the closest face of every part that a vertex touches, or may touch until the next search.

    The body is at a share of its way. A part is not searched for a vertex that cannot come near it until the
    next search.
    """
    for vertex in range(len(passage.points)):
        point = combine(ONE - share, load(passage.start, vertex), share, load(passage.end, vertex))
        store(passage.points, vertex, point)
    fit_patches(body, passage.points, passage.boxes)
    vertices, faces = np.empty(body.touches.size, np.int32), np.empty(body.touches.size, np.int32)
    stack, distances = np.empty(DEPTH, np.int32), np.empty(DEPTH, np.float32)
    count = _search(body, passage, share, positions, watch, stack, distances, vertices, faces)
    return _contacts(vertices[:count].copy(), faces[:count].copy())


@inlined
def _contacts(vertices: Array, faces: Array) -> Contacts:
    """Contacts without planes."""
    count = len(vertices)
    return Contacts(
        vertices,
        faces,
        np.zeros(count, np.int32),
        np.empty((count, 3), np.float32),
        np.empty((count, 3), np.float32),
        np.empty((count, 3), np.float32),
        np.zeros(count, np.float32),
    )


@borrowing
def _search(
    body: Body,
    passage: Passage,
    share: Number,
    positions: Array,
    watch: Watch,
    stack: Array,
    distances: Array,
    vertices: Array,
    faces: Array,
) -> int:
    """Search as `find_contacts` says, to the beginning of vertices and faces (K N,); returns how many."""
    first = passage.searches[0] == 0
    passage.searches[0] += 1
    since = share - passage.share[0]
    passage.share[0] = share
    parts, count = body.touches.shape
    near, interval, seconds, reach = watch.near, watch.interval, watch.seconds, watch.reach
    contacts, rate = 0, ONE / seconds
    for vertex in range(count):
        point, velocity = load(positions, vertex), load(watch.velocities, vertex)
        way = sub(point, load(passage.cloth, vertex))
        for part in range(parts):
            if not body.touches[part, vertex]:
                continue
            clear = passage.clear[part, vertex] - approach(passage, part, way, since)
            passage.clear[part, vertex] = clear
            fastest = SPARE * closing(passage, part, velocity, seconds) + seconds * ALERT_SPEED
            if clear > min(reach, near[vertex] + interval * fastest) + ROUNDED:
                continue
            guess = passage.hints[part, vertex]
            known = passage.before.faces[part, vertex] if first else -1
            if first and (vertex + passage.turn) % passage.renewal > 0:
                guess = known
            face, distance, slip = -1, ZERO, ZERO
            is_followed = False
            if guess >= 0:
                face, _, away = walk(body, passage.start, passage.end, share, guess, point, FOLLOWED)
                distance, slip = _past(body, passage, face, point, velocity, rate)
                is_recent = not first and share - passage.searched[part, vertex] < LONGEST * rate
                limit = reach if is_recent else min(reach, watch.followed if distance > ZERO else CLOSE)
                is_followed = dot(away, away) < limit * limit
            passage.clear[part, vertex] = ZERO
            if not is_followed:
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
                    face,
                    known,
                    stack,
                    distances,
                )
                passage.searched[part, vertex] = share
                if face >= 0:
                    distance, slip = _past(body, passage, face, point, velocity, rate)
                passage.clear[part, vertex] = max(distance, ZERO) if face >= 0 else math.sqrt(beyond)
            passage.hints[part, vertex] = face
            if face >= 0 and distance <= near[vertex] + interval * seconds * (SPARE * slip + ALERT_SPEED):
                vertices[contacts], faces[contacts] = vertex, face
                contacts += 1
        store(passage.cloth, vertex, point)
    return contacts


@inlined
def _past(
    body: Body, passage: Passage, face: int, point: Vector, velocity: Vector, rate: Number
) -> tuple[Number, Number]:
    """Distance of a point from a face, negative inside, and the speed, m/s, at which it moves past it.

    rate: frames a second.
    """
    a, b, c = corners(body.faces, passage.points, face)
    weights = closest_barycentrics(point, a, b, c)
    away = sub(point, weighted(weights, a, b, c))
    outside = dot(away, cross(sub(b, a), sub(c, a))) > ZERO
    began = weighted(weights, *corners(body.faces, passage.start, face))
    ends = weighted(weights, *corners(body.faces, passage.end, face))
    distance = length(away)
    return distance if outside else -distance, length(sub(velocity, scale(rate, sub(ends, began))))


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
    frictions: Array,
    step: Number,
    seconds: Number,
) -> None:
    """Move vertices out of the body to a distance of radius + thickness, m, without a bounce, with friction.

    The body is at a share of its way through the frame of `seconds`. step: s.
    """
    rate = ONE / seconds
    for k in range(len(contacts.vertices)):
        if contacts.wait[k] > 0:
            contacts.wait[k] -= 1
            continue
        vertex = contacts.vertices[k]
        point = load(positions, vertex)
        if contacts.slide[k] <= ZERO:
            _find_plane(contacts, body, passage, share, k, point)
        way, normal = load(contacts.ways, k), load(contacts.normals, k)
        away = sub(point, combine(ONE, load(contacts.points, k), share, way))
        gap = dot(away, normal) - radius - thickness[vertex]
        surface = scale(rate, way)
        slip = sub(load(velocities, vertex), surface)
        if gap >= ZERO:
            speed = length(slip)
            wait = int(gap / (TWO * step * (speed + ALERT_SPEED)))
            contacts.wait[k] = wait
            contacts.slide[k] -= speed * step * np.float32(wait + 1)
            continue
        approach = dot(slip, normal)
        along = sub(slip, scale(approach, normal))
        stopped = max(-approach, ZERO)
        # The approach of body and cloth in this substep is undone at any speed: a tight skirt would sink in.
        depth = -gap
        pushed = depth if depth < SHALLOW else min(depth, (PUSH_SPEED + length(surface) + stopped) * step)
        store(positions, vertex, combine(ONE, point, pushed, normal))
        speed, friction = length(along), frictions[vertex]
        kept = ONE - friction * stopped / speed if speed > friction * stopped else ZERO
        slip = combine(kept, along, approach + stopped, normal)
        store(velocities, vertex, add(surface, slip))
        contacts.slide[k] -= (kept * speed + stopped) * step + pushed


@inlined
def _find_plane(
    contacts: Contacts, body: Body, passage: Passage, share: Number, k: int, point: Vector
) -> None:
    """Find the closest point of the body, from face to neighbouring face, and the plane there."""
    start, end, normals = passage.start, passage.end, passage.normals
    face, weights, away = walk(body, start, end, share, contacts.faces[k], point, STEPS)
    contacts.faces[k] = face
    a, b, c = body.faces[face, 0], body.faces[face, 1], body.faces[face, 2]
    find_normals(body, passage, face)
    outwards = weighted(weights, load(normals, a), load(normals, b), load(normals, c))
    side = ONE if dot(away, outwards) >= ZERO else -ONE
    distance = length(away)
    began = weighted(weights, *corners(body.faces, start, face))
    ends = weighted(weights, *corners(body.faces, end, face))
    store(contacts.points, k, began)
    store(contacts.ways, k, sub(ends, began))
    store(contacts.normals, k, scale(side / distance, away) if distance > ON_SURFACE else unit(outwards))
    contacts.slide[k] = SLIDE
