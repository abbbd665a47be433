"""Closest points on faces and edges."""

import numpy as np

from uvcloth.physics.cloth.compiled import inlined
from uvcloth.physics.cloth.vectors import ONE, TINY, ZERO, add, clamp, combine, dot, load, scale, sub


@inlined
def closest_barycentrics(point, a, b, c):
    """Barycentric coordinates of the point of a triangle that is closest to a point (Ericson 2005, section 5.1.5)."""
    ab, ac, ap = sub(b, a), sub(c, a), sub(point, a)
    d1, d2 = dot(ab, ap), dot(ac, ap)
    if d1 <= ZERO and d2 <= ZERO:
        return ONE, ZERO, ZERO
    bp = sub(point, b)
    d3, d4 = dot(ab, bp), dot(ac, bp)
    if d3 >= ZERO and d4 <= d3:
        return ZERO, ONE, ZERO
    cp = sub(point, c)
    d5, d6 = dot(ab, cp), dot(ac, cp)
    if d6 >= ZERO and d5 <= d6:
        return ZERO, ZERO, ONE
    vc = d1 * d4 - d3 * d2
    if vc <= ZERO and d1 >= ZERO and d3 <= ZERO:
        t = d1 / (d1 - d3)
        return ONE - t, t, ZERO
    vb = d5 * d2 - d1 * d6
    if vb <= ZERO and d2 >= ZERO and d6 <= ZERO:
        t = d2 / (d2 - d6)
        return ONE - t, ZERO, t
    va = d3 * d6 - d5 * d4
    if va <= ZERO and d4 >= d3 and d5 >= d6:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return ZERO, ONE - t, t
    share = ONE / (va + vb + vc)
    return ONE - (vb + vc) * share, vb * share, vc * share


@inlined
def weighted(weights, a, b, c):
    """Point of a triangle at barycentric coordinates."""
    return add(combine(weights[0], a, weights[1], b), scale(weights[2], c))


@inlined
def squared_distance(faces, points, face, point):
    """Squared distance of a point from a face of a mesh at points (N, 3)."""
    a, b, c = load(points, faces[face, 0]), load(points, faces[face, 1]), load(points, faces[face, 2])
    away = sub(point, weighted(closest_barycentrics(point, a, b, c), a, b, c))
    return dot(away, away)


@inlined
def closest_on_segments(p0, p1, q0, q1):
    """Shares s, t of the closest points p0 + s (p1 - p0) and q0 + t (q1 - q0) of two segments, and their difference."""
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
