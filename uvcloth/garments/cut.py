"""Cut a triangle mesh exactly along the zero level of a scalar field given at its vertices."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def cut(faces: Indices, field: Array) -> tuple[Indices, Array, Indices]:
    """Keep the part where field (V,) is positive; triangles across the zero level are clipped.

    Returns edges (P, 2), along (P,), faces (Q, 3): every vertex of the result lies on the edge between two
    old vertices, at the share `along` from the first (an old vertex that was kept is an edge to itself).
    """
    inside = field[faces] > 0
    count = inside.sum(axis=1)
    whole = faces[count == 3]
    one = _rotated(faces[count == 1], inside[count == 1], lonely=True)
    two = _rotated(faces[count == 2], inside[count == 2], lonely=False)
    ends = [one[:, [0, 1]], one[:, [0, 2]], two[:, [1, 0]], two[:, [2, 0]]]
    crossings = np.concatenate(ends)
    key, inverse = np.unique(np.sort(crossings, axis=1), axis=0, return_inverse=True)
    new = len(field) + inverse.reshape(-1)
    n1, n2 = len(one), len(two)
    a, b, c, d = new[:n1], new[n1 : 2 * n1], new[2 * n1 : 2 * n1 + n2], new[2 * n1 + n2 :]
    corners = [
        whole,
        np.column_stack([one[:, 0], a, b]),
        np.column_stack([two[:, 1], two[:, 2], d]),
        np.column_stack([two[:, 1], d, c]),
    ]
    result = np.concatenate(corners)
    used, renumbered = np.unique(result, return_inverse=True)
    old = np.arange(len(field))
    edges = np.concatenate([np.column_stack([old, old]), key])[used]
    start, end = field[edges[:, 0]], field[edges[:, 1]]
    gap = np.where(edges[:, 0] == edges[:, 1], 1.0, start - end)
    along = np.where(edges[:, 0] == edges[:, 1], 0.0, start / gap)
    return edges, along, renumbered.reshape(-1, 3)


def place(vertices: Array, edges: Indices, along: Array) -> Array:
    """Positions of cut vertices on the edges of the mesh (V, 3) they came from."""
    return vertices[edges[:, 0]] * (1 - along[:, None]) + vertices[edges[:, 1]] * along[:, None]


def _rotated(faces: Indices, inside: NDArray[np.bool_], lonely: bool) -> Indices:
    """Rotate corners so that the one corner that is inside (or outside, if not lonely) comes first."""
    first = (inside if lonely else ~inside).argmax(axis=1)
    return np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
