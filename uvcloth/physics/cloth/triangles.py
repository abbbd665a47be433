"""Closest points on faces and edges."""

import numpy as np

from uvcloth.physics.cloth.vectors import (
    ONE,
    TINY,
    ZERO,
    Array,
    Number,
    Vector,
    add,
    clamp,
    combine,
    dot,
    load,
    scale,
    sub,
)
from uvcloth.process.compiled import inlined


@inlined
def closest_barycentrics(point: Vector, a: Vector, b: Vector, c: Vector) -> Vector:
    """Barycentric coordinates of the point of a triangle that is closest to a point.

    By the regions of Ericson 2005, "Real-Time Collision Detection", section 5.1.5.
    """
    ab, ac, ap, bp, cp = sub(b, a), sub(c, a), sub(point, a), sub(point, b), sub(point, c)
    d1, d2, d3, d4, d5, d6 = dot(ab, ap), dot(ac, ap), dot(ab, bp), dot(ac, bp), dot(ab, cp), dot(ac, cp)
    to_a, to_b, to_c = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= ZERO and d2 <= ZERO:
        weights = ONE, ZERO, ZERO
    elif d3 >= ZERO and d4 <= d3:
        weights = ZERO, ONE, ZERO
    elif d6 >= ZERO and d5 <= d6:
        weights = ZERO, ZERO, ONE
    elif to_c <= ZERO and d1 >= ZERO and d3 <= ZERO:
        along = d1 / (d1 - d3)
        weights = ONE - along, along, ZERO
    elif to_b <= ZERO and d2 >= ZERO and d6 <= ZERO:
        along = d2 / (d2 - d6)
        weights = ONE - along, ZERO, along
    elif to_a <= ZERO and d4 >= d3 and d5 >= d6:
        along = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        weights = ZERO, ONE - along, along
    else:
        share = ONE / (to_a + to_b + to_c)
        weights = ONE - (to_b + to_c) * share, to_b * share, to_c * share
    return weights


@inlined
def weighted(weights: Vector, a: Vector, b: Vector, c: Vector) -> Vector:
    """Point of a triangle at barycentric coordinates."""
    return add(combine(weights[0], a, weights[1], b), scale(weights[2], c))


@inlined
def squared_distance(faces: Array, points: Array, face: int, point: Vector) -> Number:
    """Squared distance of a point from a face of a mesh at points (N, 3)."""
    a, b, c = load(points, faces[face, 0]), load(points, faces[face, 1]), load(points, faces[face, 2])
    away = sub(point, weighted(closest_barycentrics(point, a, b, c), a, b, c))
    return dot(away, away)


@inlined
def closest_on_segments(p0: Vector, p1: Vector, q0: Vector, q1: Vector) -> tuple[Number, Number, Vector]:
    """Closest points p0 + s (p1 - p0), q0 + t (q1 - q0) of two segments: s, t, and their difference."""
    along_p, along_q, between = sub(p1, p0), sub(q1, q0), sub(p0, q0)
    a, e, b = dot(along_p, along_p), dot(along_q, along_q), dot(along_p, along_q)
    c, f = dot(along_p, between), dot(along_q, between)
    slant = a * e - b * b
    s = clamp((b * f - c * e) / slant, ZERO, ONE) if slant > PARALLEL * a * e else np.float32(0.5)
    t = (b * s + f) / (e + TINY)
    if t < ZERO:
        t, s = ZERO, clamp(-c / (a + TINY), ZERO, ONE)
    elif t > ONE:
        t, s = ONE, clamp((b - c) / (a + TINY), ZERO, ONE)
    return s, t, sub(combine(ONE, p0, s, along_p), combine(ONE, q0, t, along_q))


PARALLEL = np.float32(1e-6)
"""Squared sine of the angle below which two segments count as parallel."""
