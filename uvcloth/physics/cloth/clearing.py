"""Clearing: moves fine meshes off the skin, in which garments on cages may lie by a few millimetres."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uvcloth.physics.cloth.body_contact import Contacts, Watch, find_contacts
from uvcloth.physics.cloth.moving_body import (
    Body,
    Memory,
    Passage,
    begin_passage,
    corners,
    end_passage,
    find_normals,
)
from uvcloth.physics.cloth.triangles import closest_barycentrics, weighted
from uvcloth.physics.cloth.vectors import (
    ONE,
    ZERO,
    Array,
    Number,
    Vector,
    add,
    combine,
    dot,
    length,
    load,
    store,
    sub,
    unit,
)
from uvcloth.process.compiled import compiled, inlined

RENEWAL = 8
"""Frames from one search of the whole body for a vertex to the next."""

SPREAD = np.float32(0.6)
"""Share of the mean move of its neighbours by which a vertex that is free follows them."""

FREE_MOVE = np.float32(1e-3)
"""Metres of its own move at which a vertex no longer follows its neighbours."""

INWARD = np.float32(-0.7)
"""Cosine to the normal below which the way from the closest face leads inwards: faces fold at joints."""

WATCHED = np.float32(0.004)
"""Metres more than the clearance within which vertices are watched: their neighbours may move them."""

BENEATH_FACES = np.float32(0.001)
"""Metres that faces keep off skin that is curved between their corners, an elbow's or a knee's."""

EIGHTH = np.float32(0.125)

PASSES = 3
"""Times that vertices are moved off the skin; after all but the last one their neighbours follow."""


class FineMesh(NamedTuple):
    """Mesh that is cleared.

    thickness: (N,) m of other cloth between a vertex and the body. ring_starts: (N + 1,), ring: the vertices
    on an edge with each.
    """

    thickness: NDArray[np.float32]
    ring_starts: NDArray[np.int32]
    ring: NDArray[np.int32]


class FineState(NamedTuple):
    """A fine mesh at (N, 3) m and a body at (V, 3) m, around one origin, and the search results.

    frame: number of earlier frames.
    """

    positions: NDArray[np.float32]
    body: NDArray[np.float32]
    near: Memory
    frame: int


@compiled
def clear(
    mesh: FineMesh,
    body: Body,
    before: FineState,
    points: Array,
    positions: Array,
    clearance: Number,
    reach: Number,
) -> FineState:
    """Move vertices (N, 3) m to at least a clearance, m, off the body at points (V, 3) m.

    before: the frame before. reach: metres within which the skin is searched; deeper vertices stay.
    """
    passage = begin_passage(body, before.body, points, before.positions, before.near, before.frame, RENEWAL)
    still, near = np.zeros_like(positions), clearance + WATCHED + mesh.thickness
    watch = Watch(still, near, ZERO, ONE, reach, reach)
    contacts = find_contacts(body, passage, ONE, positions, watch)
    for face in contacts.faces:
        find_normals(body, passage, face)
    cleared, moves = positions.copy(), np.empty_like(positions)
    heights, outwards = clearance + mesh.thickness, np.zeros_like(positions)
    for each in range(PASSES):
        moves[:] = ZERO
        _push(body, passage, contacts, cleared, moves, heights, outwards)
        if each < PASSES - 1:
            _spread(mesh, cleared, moves)
            _raise_over_curves(mesh, contacts, cleared, outwards, heights)
    return FineState(cleared, points, end_passage(passage, cleared), before.frame + 1)


@compiled
def follow(mesh: FineMesh, positions: Array, moves: Array) -> None:
    """Let vertices (N, 3) m that did not move follow their neighbours' moves (N, 3) m, in place."""
    _spread(mesh, positions, moves)


@inlined
def _push(
    body: Body,
    passage: Passage,
    contacts: Contacts,
    positions: Array,
    moves: Array,
    heights: Array,
    outwards: Array,
) -> None:
    """Move vertices to their heights (N,) m over the skin, and note its normals (N, 3) there, in place."""
    for k in range(len(contacts.vertices)):
        vertex, face = contacts.vertices[k], contacts.faces[k]
        distance, normal = _signed(body, passage, face, load(positions, vertex))
        lack = heights[vertex] - distance
        if lack > ZERO:
            store(positions, vertex, combine(ONE, load(positions, vertex), lack, normal))
            store(moves, vertex, combine(ONE, load(moves, vertex), lack, normal))
            store(outwards, vertex, normal)


@inlined
def _raise_over_curves(
    mesh: FineMesh, contacts: Contacts, positions: Array, outwards: Array, heights: Array
) -> None:
    """Raise the heights (N,) m of vertices over convex skin, which comes through the edges between them.

    An arc between two points rises over their chord by about an eighth of its length times the angle between
    its normals.
    """
    for vertex in contacts.vertices:
        normal = load(outwards, vertex)
        if dot(normal, normal) == ZERO:
            continue
        for place in range(mesh.ring_starts[vertex], mesh.ring_starts[vertex + 1]):
            other = load(outwards, mesh.ring[place])
            way = sub(load(positions, mesh.ring[place]), load(positions, vertex))
            if dot(other, other) > ZERO and dot(way, normal) < ZERO:
                rise = min(EIGHTH * length(way) * length(sub(other, normal)), WATCHED)
                heights[vertex] = max(heights[vertex], mesh.thickness[vertex] + rise + BENEATH_FACES)


@inlined
def _spread(mesh: FineMesh, positions: Array, moves: Array) -> None:
    for vertex in range(len(positions)):
        first, last = mesh.ring_starts[vertex], mesh.ring_starts[vertex + 1]
        free = ONE - length(load(moves, vertex)) / FREE_MOVE
        if last > first and free > ZERO:
            mean = (ZERO, ZERO, ZERO)
            for place in range(first, last):
                mean = add(mean, load(moves, mesh.ring[place]))
            share = SPREAD * free / np.float32(last - first)
            store(positions, vertex, combine(ONE, load(positions, vertex), share, mean))


@inlined
def _signed(body: Body, passage: Passage, face: int, point: Vector) -> tuple[Number, Vector]:
    """Distance of a point from a face, negative inside, and the interpolated normal there.

    From the inside, the way to the closest face jumps where another face becomes closest; normals do not.
    """
    places = corners(body.faces, passage.points, face)
    weights = closest_barycentrics(point, *places)
    away = sub(point, weighted(weights, *places))
    outwards = weighted(weights, *corners(body.faces, passage.normals, face))
    normal, distance = unit(outwards), length(away)
    inside = dot(away, normal) < INWARD * distance
    return -distance if inside else distance, normal
