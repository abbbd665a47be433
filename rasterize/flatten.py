"""Flatten a chart onto a rectangle: little distortion, and not a single fold."""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from rasterize.charts import boundary_loops
from rasterize.errors import InputError

MAX_DESCENT_STEPS = 300
"""At most this many descent steps; a chart converges in 10 to 50."""

SIDE_BULGE = 0.01
"""Share of the chart by which sides bend outwards, so that a face with all corners on one side keeps an area.
"""


def flatten(
    vertices: np.ndarray, faces: np.ndarray, corners: np.ndarray, aspect: float, place: str
) -> np.ndarray:
    """Map a disk onto the unit square, four of its boundary vertices onto the corners: (n, 2).

    vertices: (n, 3). faces: (m, 3), a topological disk but for small holes. corners: four boundary vertices,
    counter-clockwise from the lower left. aspect: width over height that the square will be stretched to.
    Starts from the boundary by arc length and mean-value coordinates (Floater 2003), which cannot fold over a
    convex boundary, and then lowers the distortion without folding. Raises InputError naming `place`.
    """
    loop = boundary_loops(faces)[0]
    starts = [np.flatnonzero(loop == corner) for corner in corners]
    if any(len(ends) != 1 for ends in starts):
        raise InputError(f"{place}: a corner of the chart is not on its outer boundary")
    loop = np.roll(loop, -int(starts[0][0]))
    marks = [int(np.flatnonzero(loop == corner)[0]) for corner in corners] + [len(loop)]
    if marks != sorted(marks):
        raise InputError(f"{place}: the corners of the chart are not in order around its boundary")

    uvs = np.zeros((len(vertices), 2))
    on_side = np.zeros((len(vertices), 4), dtype=bool)
    free = np.ones((len(vertices), 2), dtype=bool)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=np.float64)
    closed = np.append(loop, loop[0])
    for side in range(4):
        run = closed[marks[side] : marks[side + 1] + 1]
        lengths = np.linalg.norm(np.diff(vertices[run], axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()
        chord = square[side + 1] - square[side]
        outward = np.array([chord[1], -chord[0]])
        uvs[run] = (
            square[side] + along[:, None] * chord + (4 * SIDE_BULGE * along * (1 - along))[:, None] * outward
        )
        free[run] &= chord != 0
        on_side[run, side] = True
    inner: np.ndarray = np.logical_and(free[:, 0], free[:, 1])
    uvs = _solve(_mean_value_weights(vertices, faces), uvs, inner)
    uvs = (uvs + SIDE_BULGE) / (1 + 2 * SIDE_BULGE)
    # A face with all corners on one side is as thin as the bulge: no movement can help it.
    thin = on_side[faces].all(1).any(1)
    return _relax(vertices, faces, uvs, free=free, thin=thin, aspect=aspect)


def _mean_value_weights(vertices: np.ndarray, faces: np.ndarray) -> sparse.csr_matrix:
    """Weights (n, n): w_ij = (tan(a / 2) + tan(b / 2)) / |ij|, a and b the angles at i beside the edge."""
    rows, cols, values = [], [], []
    for corner in range(3):
        i, j, k = (faces[:, (corner + step) % 3] for step in range(3))
        to_j, to_k = vertices[j] - vertices[i], vertices[k] - vertices[i]
        length_j, length_k = np.linalg.norm(to_j, axis=1), np.linalg.norm(to_k, axis=1)
        cosine = np.clip((to_j * to_k).sum(1) / (length_j * length_k), -0.999, 0.999)
        half = np.sqrt((1 - cosine) / (1 + cosine))
        rows += [i, i]
        cols += [j, k]
        values += [half / length_j, half / length_k]
    shape = (len(vertices), len(vertices))
    return sparse.csr_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))), shape=shape
    )


def _solve(weights: sparse.csr_matrix, uvs: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """Put each inner vertex at the weighted mean of its neighbours, the others staying where they are."""
    laplacian = sparse.diags(np.asarray(weights.sum(1)).ravel()) - weights
    rows = laplacian.tocsr()[inner]
    solved = uvs.copy()
    solved[inner] = splu(rows[:, inner].tocsc()).solve(-(rows[:, ~inner] @ uvs[~inner]))
    return solved


@dataclass(frozen=True)
class _Distortion:
    """Symmetric Dirichlet energy of a flattened chart, area x (|J|^2 + |J^-1|^2).

    faces: (m, 3). slopes: (2, m, 3), d/dx and d/dy of a linear function from its values at the corners of the
    face laid flat. area: (m,) weights of the faces. size: (2,) of the rectangle. free: (n, 2) coordinates
    that may move.
    """

    faces: np.ndarray
    slopes: np.ndarray
    area: np.ndarray
    size: np.ndarray
    free: np.ndarray

    def energy(self, uvs: np.ndarray) -> tuple[float, np.ndarray]:
        """Energy at uvs (n, 2) and its gradient (n, 2), zero where fixed; infinite if a face turns over."""
        jacobian = np.einsum("dfc,fcu->fud", self.slopes, uvs[self.faces] * self.size)
        det = np.linalg.det(jacobian)
        if det.min() <= 0:
            return np.inf, uvs
        square = (jacobian**2).sum((1, 2))
        cofactor = np.stack(
            [
                np.stack([jacobian[:, 1, 1], -jacobian[:, 1, 0]], axis=1),
                np.stack([-jacobian[:, 0, 1], jacobian[:, 0, 0]], axis=1),
            ],
            axis=1,
        )
        slope = (2 * self.area * (1 + det**-2))[:, None, None] * jacobian
        slope -= (2 * self.area * square * det**-3)[:, None, None] * cofactor
        per_corner = np.einsum("dfc,fud->fcu", self.slopes, slope) * self.size
        gradient = np.zeros_like(uvs)
        np.add.at(gradient, self.faces.ravel(), per_corner.reshape(-1, 2))
        return float((self.area * square * (1 + det**-2)).sum()), np.where(self.free, gradient, 0.0)


def _relax(
    vertices: np.ndarray,
    faces: np.ndarray,
    uvs: np.ndarray,
    *,
    free: np.ndarray,
    thin: np.ndarray,
    aspect: float,
) -> np.ndarray:
    """Lower the distortion of a flattened chart without ever turning a face over.

    Gradient descent preconditioned with the Laplacian (Kovalsky et al. 2016); free: (n, 2), the coordinates
    that may move (boundary vertices slide along their side). Faces marked thin only must not turn over.
    """
    slopes, double_area = _face_slopes(vertices, faces)
    size = np.sqrt(double_area.sum() / 2 / aspect) * np.array([aspect, 1.0])
    distortion = _Distortion(faces, slopes, np.where(thin, 0.0, double_area / 2), size, free)
    laplacian = _laplacian(len(vertices), faces, slopes, double_area / 2)
    solvers = [
        (free[:, axis], splu((laplacian[free[:, axis]][:, free[:, axis]] * size[axis] ** 2).tocsc()))
        for axis in range(2)
    ]
    step = 1.0
    current, gradient = distortion.energy(uvs)
    for _ in range(MAX_DESCENT_STEPS):
        direction = np.zeros_like(uvs)
        for axis, (moving, solver) in enumerate(solvers):
            direction[moving, axis] = -solver.solve(gradient[moving, axis])
        slope = float((direction * gradient).sum())
        while step > 1e-12:
            tried, tried_gradient = distortion.energy(uvs + step * direction)
            if tried < current + 1e-4 * step * slope:
                break
            step *= 0.5
        else:
            break
        uvs = uvs + step * direction
        converged = current - tried < 1e-5 * current
        current, gradient = tried, tried_gradient
        if converged:
            break
        step *= 3.0
    return uvs


def _face_slopes(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (2, m, 3) of linear functions on the faces laid flat, and twice the areas (m,) of the faces.

    Corner 0 of a flat face lies at the origin, corner 1 on the x axis.
    """
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    length = np.linalg.norm(b - a, axis=1)
    double_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    x = ((c - a) * (b - a)).sum(1) / length
    y = double_area / length
    slopes = np.stack(
        [
            np.stack([-1 / length, 1 / length, np.zeros_like(x)], axis=1),
            np.stack([(x / length - 1) / y, -x / (length * y), 1 / y], axis=1),
        ]
    )
    return slopes, double_area


def _laplacian(count: int, faces: np.ndarray, slopes: np.ndarray, area: np.ndarray) -> sparse.csr_matrix:
    """Cotangent Laplacian (count, count) of a mesh from the slopes (2, m, 3) and areas (m,) of its faces."""
    rows = np.tile(np.arange(len(faces)), 3)
    shape = (len(faces), count)
    gradients = [sparse.csr_matrix((d.T.ravel(), (rows, faces.T.ravel())), shape=shape) for d in slopes]
    return sum(g.T @ sparse.diags(area) @ g for g in gradients).tocsr()
