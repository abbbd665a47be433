"""Vectors of three numbers, as tuples that stay in registers."""

import math
from typing import Any

import numpy as np

from uvcloth.process.compiled import inlined

Number = Any
"""A float32 in registers; mypy does not know the type of its arithmetic."""

Vector = tuple[Number, Number, Number]
Array = np.ndarray

# Numba takes a literal as float64 and would compute the whole loop in that: constants are float32.
ZERO, ONE, TWO, HALF, THIRD = (np.float32(value) for value in (0.0, 1.0, 2.0, 0.5, 1.0 / 3.0))
TINY = np.float32(1e-20)


@inlined
def load(points: Array, index: int) -> Vector:
    """Row of an array (N, 3)."""
    return points[index, 0], points[index, 1], points[index, 2]


@inlined
def store(points: Array, index: int, a: Vector) -> None:
    """Write a row of an array (N, 3)."""
    points[index, 0] = a[0]
    points[index, 1] = a[1]
    points[index, 2] = a[2]


@inlined
def add(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def sub(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inlined
def scale(s: Number, a: Vector) -> Vector:
    return s * a[0], s * a[1], s * a[2]


@inlined
def combine(s: Number, a: Vector, t: Number, b: Vector) -> Vector:
    """s a + t b."""
    return s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]


@inlined
def dot(a: Vector, b: Vector) -> Number:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def length(a: Vector) -> Number:
    return math.sqrt(dot(a, a))


@inlined
def unit(a: Vector) -> Vector:
    return scale(ONE / (length(a) + TINY), a)


@inlined
def clamp(value: Number, low: Number, high: Number) -> Number:
    return min(max(value, low), high)


ARC = tuple(
    np.float32(value)
    for value in (
        0.999996112,
        -0.333173681,
        0.198078157,
        -0.132333423,
        0.0796236723,
        -0.0336042187,
        0.0068117923,
    )
)
"""Coefficients of atan(x) / x in powers of x^2 on [0, 1], with the least largest error."""

QUARTER_TURN, HALF_TURN = np.float32(0.5 * math.pi), np.float32(math.pi)


@inlined
def angle(y: Number, x: Number) -> Number:
    """Angle of (x, y) as of atan2, to within 1e-6 radians, in arithmetic that is vectorized."""
    high = max(abs(x), abs(y)) + TINY
    ratio = min(abs(x), abs(y)) / high
    s = ratio * ratio
    arc = ARC[4] + s * (ARC[5] + s * ARC[6])
    arc = ratio * (ARC[0] + s * (ARC[1] + s * (ARC[2] + s * (ARC[3] + s * arc))))
    arc = QUARTER_TURN - arc if abs(y) > abs(x) else arc
    arc = HALF_TURN - arc if x < ZERO else arc
    return -arc if y < ZERO else arc
