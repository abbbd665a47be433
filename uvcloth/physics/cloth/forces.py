"""Forces inside cloth: membrane and air on its faces, bending at its hinges.

Corners are gathered for a block of faces, whose forces are computed side by side in vector registers and
added to the vertices. Moving numbers takes longer than computing with them: it is done eight rows at a time.
"""

import math
from typing import NamedTuple

import numpy as np

from uvcloth.physics.cloth.lanes import LANES, gather_rows, scatter_columns
from uvcloth.physics.cloth.vectors import (
    HALF,
    ONE,
    THIRD,
    TINY,
    TWO,
    ZERO,
    Array,
    Number,
    Vector,
    add,
    angle,
    combine,
    cross,
    dot,
    load,
    scale,
    store,
    sub,
)
from uvcloth.process.compiled import compiled, inlined

BLOCK = 64
"""Faces or hinges that are computed side by side."""

TILT = np.float32(1e-7)
"""Least difference of squared principal stretches, halved, so that their directions are defined."""

FLATTENED = np.float32(1e-2)
"""Square of the stretch below which compressive strain does not grow further."""

SQUEEZED = 0.5
"""Share of its area at rest below which the bending forces of a face fade: they would grow without bound."""


class Membrane(NamedTuple):
    """Faces of cloth, padded to whole blocks.

    size: M, without the padding. corners: (3, M+) uint32. inverse: (4, M+) 1/m, entries 00, 01, 10, 11 of
    the inverse of the rest edges' matrix. area: (M+,) m2. shear, spread: (M+,) N/m, Lame parameters mu,
    lambda. reduction: root of the share of the stiffness that is left where cloth begins to be compressed;
    it grows to 1 where a face is flat, or shirts would ruck up on hips and stay so. damping: (M+,) N s/m, of
    strain rates. pressure: (M+,) kg/m3, half the density of air times the drag coefficient.
    """

    size: int
    corners: np.ndarray
    inverse: np.ndarray
    area: np.ndarray
    shear: np.ndarray
    spread: np.ndarray
    reduction: np.float32
    damping: np.ndarray
    pressure: np.ndarray


class Hinges(NamedTuple):
    """Edges between two faces, padded to whole blocks.

    size: E, without the padding. corners: (4, E+) uint32, the vertices opposite of the edge, then its ends.
    stiffness: (E+,) N m. rest: (E+,) radians. floors: (2, E+) m4, square of the doubled area of each face
    below which forces fade. damping: s, times the stiffness.
    """

    size: int
    corners: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray
    floors: np.ndarray
    damping: np.float32


@inlined
def _strain(squared: Number) -> tuple[Number, Number]:
    """Strain of a squared principal stretch, and its slope over the stretch, divided by that."""
    stretch = math.sqrt(squared)
    if squared > ONE:
        return HALF * (squared - ONE), ONE
    return stretch - ONE, ONE / stretch


@inlined
def _buckled(membrane: Membrane, strain: Number) -> tuple[Number, Number]:
    """Strain that stresses a face, reduced in compression, and its slope over the strain.

    The slope rises from `reduction` for the first folds to 1 at a strain of -1, where the face is flat.
    """
    stiffening = membrane.reduction - ONE
    slope = membrane.reduction + stiffening * strain
    reduced = strain * (membrane.reduction + HALF * stiffening * strain)
    if strain > ZERO:
        slope, reduced = ONE, strain
    return reduced, slope


@inlined
def face_forces(
    membrane: Membrane,
    k: Number,
    xa: Vector,
    xb: Vector,
    xc: Vector,
    va: Vector,
    vb: Vector,
    vc: Vector,
    wind: Vector,
) -> tuple[Vector, Vector, Vector]:
    """Forces, N, on the corners of face k.

    Energy mu (e1^2 + e2^2) + lambda (e1 + e2)^2 / 2 per area, of the principal strains e1 and e2: Green's in
    tension, (s^2 - 1) / 2 at a stretch s, which stiffens as a knit does, and Biot's in compression, s - 1,
    so that squeezed cloth does not give way. Negative strains are reduced for coarse meshes, which cannot
    buckle below their edge length, see `_buckled`. Viscous stress by the rate of the Green strain is added,
    and drag of still air by the square of the speed along the normal. xa, xb, xc: m. va, vb, vc: m/s,
    relative to a frame of reference that moves at `wind`, m/s, through the air.
    """
    d00, d01, d10, d11 = (
        membrane.inverse[0, k],
        membrane.inverse[1, k],
        membrane.inverse[2, k],
        membrane.inverse[3, k],
    )
    area, shear, damping = membrane.area[k], membrane.shear[k], membrane.damping[k]
    p, q, p_rate, q_rate = sub(xb, xa), sub(xc, xa), sub(vb, va), sub(vc, va)
    f, g = combine(d00, p, d10, q), combine(d01, p, d11, q)
    f_rate, g_rate = combine(d00, p_rate, d10, q_rate), combine(d01, p_rate, d11, q_rate)
    c00, c11, c01 = dot(f, f), dot(g, g), dot(f, g)
    mean, half = HALF * (c00 + c11), HALF * (c00 - c11)
    apart = math.sqrt(half * half + c01 * c01) + TILT
    (high, over_long), (low, over_short) = _strain(mean + apart), _strain(max(mean - apart, FLATTENED))
    # Both stresses have to come from one energy: each is multiplied by the slope of its reduced strain.
    (long, upper), (short, lower) = _buckled(membrane, high), _buckled(membrane, low)
    trace = membrane.spread[k] * (long + short)
    pull = upper * (TWO * shear * long + trace) * over_long
    push = lower * (TWO * shear * short + trace) * over_short
    middle, turned = HALF * (pull + push), HALF * (pull - push) / apart
    s00 = middle + turned * half + damping * dot(f, f_rate)
    s11 = middle - turned * half + damping * dot(g, g_rate)
    s01 = turned * c01 + HALF * damping * (dot(f, g_rate) + dot(g, f_rate))
    first, second = combine(s00, f, s01, g), combine(s01, f, s11, g)
    force_b = combine(-area * d00, first, -area * d01, second)
    force_c = combine(-area * d10, first, -area * d11, second)
    normal = cross(f, g)
    speed = dot(add(add(va, wind), scale(THIRD, add(p_rate, q_rate))), normal) / math.sqrt(
        dot(normal, normal) + TINY
    )
    drag = scale(-THIRD * membrane.pressure[k] * area * speed * abs(speed), normal)
    force_a = sub(sub(drag, force_b), force_c)
    return force_a, add(drag, force_b), add(drag, force_c)


@inlined
def hinge_forces(
    hinges: Hinges,
    k: Number,
    x0: Vector,
    x1: Vector,
    xa: Vector,
    xb: Vector,
    v0: Vector,
    v1: Vector,
    va: Vector,
    vb: Vector,
) -> tuple[Vector, Vector, Vector, Vector]:
    """Forces, N, on the two opposite vertices and the two ends of hinge k.

    Energy K (theta - theta0)^2 / 2 of the dihedral angle, damped by its rate.
    """
    along = sub(xb, xa)
    n0, n1 = cross(sub(xa, x0), sub(xb, x0)), cross(sub(xb, x1), sub(xa, x1))
    squared = dot(along, along) + TINY
    shorter = ONE / math.sqrt(squared)
    size = squared * shorter
    theta = angle(dot(cross(n0, n1), along) * shorter, dot(n0, n1))
    s0, s1 = dot(n0, n0), dot(n1, n1)
    o0, o1 = scale(ONE / (s0 + TINY), n0), scale(ONE / (s1 + TINY), n1)
    g0, g1 = scale(-size, o0), scale(-size, o1)
    ga = combine(dot(sub(xb, x0), along) * shorter, o0, dot(sub(xb, x1), along) * shorter, o1)
    gb = combine(-dot(sub(xa, x0), along) * shorter, o0, -dot(sub(xa, x1), along) * shorter, o1)
    rate = dot(g0, v0) + dot(g1, v1) + dot(ga, va) + dot(gb, vb)
    # All four forces fade together, or they would turn the cloth as a whole.
    fade = min(ONE, s0 / (hinges.floors[0, k] + TINY), s1 / (hinges.floors[1, k] + TINY))
    moment = -fade * hinges.stiffness[k] * (theta - hinges.rest[k] + hinges.damping * rate)
    return scale(moment, g0), scale(moment, g1), scale(moment, ga), scale(moment, gb)


@compiled
def add_elastic_forces(
    membrane: Membrane, hinges: Hinges, positions: Array, velocities: Array, wind: Vector, forces: Array
) -> None:
    """Add the forces, N, of all faces and hinges to forces (N, 3).

    Indices are unsigned. With signed ones, which may count from the end, the compiler takes memory behind an
    array as a part of it; where `pushed` happens to lie there, other code runs, which rounds differently.
    """
    rows, sums = np.empty((len(forces), 8), np.float32), np.empty((len(forces), 4), np.float32)
    for i in range(len(forces)):
        for j in range(3):
            rows[i, j], rows[i, 4 + j], sums[i, j] = positions[i, j], velocities[i, j], forces[i, j]
        sums[i, 3] = ZERO
    lines = np.zeros((24, BLOCK), np.float32)
    pushed = np.empty((12, BLOCK), np.float32)
    for start in range(0, membrane.size, BLOCK):
        size = min(BLOCK, membrane.size - start)
        _gather(membrane.corners, 3, start, size, rows, lines)
        for k in range(BLOCK):
            a, b, c = face_forces(
                membrane,
                np.uint64(start) + np.uint64(k),
                _column(lines, 0, k),
                _column(lines, 1, k),
                _column(lines, 2, k),
                _column(lines, 4, k),
                _column(lines, 5, k),
                _column(lines, 6, k),
                wind,
            )
            _put(pushed, 0, k, a)
            _put(pushed, 1, k, b)
            _put(pushed, 2, k, c)
        _scatter(membrane.corners, 3, start, size, pushed, sums)
    for start in range(0, hinges.size, BLOCK):
        size = min(BLOCK, hinges.size - start)
        _gather(hinges.corners, 4, start, size, rows, lines)
        for k in range(BLOCK):
            a, b, c, d = hinge_forces(
                hinges,
                np.uint64(start) + np.uint64(k),
                _column(lines, 0, k),
                _column(lines, 1, k),
                _column(lines, 2, k),
                _column(lines, 3, k),
                _column(lines, 4, k),
                _column(lines, 5, k),
                _column(lines, 6, k),
                _column(lines, 7, k),
            )
            _put(pushed, 0, k, a)
            _put(pushed, 1, k, b)
            _put(pushed, 2, k, c)
            _put(pushed, 3, k, d)
        _scatter(hinges.corners, 4, start, size, pushed, sums)
    for i in range(len(forces)):
        store(forces, i, load(sums, i))


@inlined
def _gather(corners: Array, count: int, start: int, size: int, rows: Array, lines: Array) -> None:
    """Copy rows (N, 8) of a block's corners to lines: corner r to those from 3 r and from 12 + 3 r on."""
    for r in range(count):
        for k in range(0, size, LANES):
            gather_rows(rows, corners, r, start + k, lines, 3 * r, k)


@inlined
def _scatter(corners: Array, count: int, start: int, size: int, pushed: Array, sums: Array) -> None:
    """Add a block's forces to the rows (N, 4) of its corners, one corner after the other."""
    whole = size - size % LANES
    for r in range(count):
        for k in range(0, whole, LANES):
            scatter_columns(pushed, 3 * r, k, corners, r, start + k, sums)
        for k in range(whole, size):
            for j in range(3):
                sums[corners[r, start + k], j] += pushed[3 * r + j, k]


@inlined
def _column(rows: Array, corner: int, k: int) -> Vector:
    return rows[3 * corner, k], rows[3 * corner + 1, k], rows[3 * corner + 2, k]


@inlined
def _put(rows: Array, corner: int, k: int, a: Vector) -> None:
    rows[3 * corner, k] = a[0]
    rows[3 * corner + 1, k] = a[1]
    rows[3 * corner + 2, k] = a[2]
