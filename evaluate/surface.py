"""The surface of a garment at rest: smoothing, and the energy of a field in bands of wavelength.

Both follow the cotangent Laplacian L with the area M of each vertex (Meyer et al. 2003), on the mesh whose
seams are welded. The waves of the surface are its eigenvectors, L u = k^2 M u, of wavelength 2 pi / k. They
are not computed: a filter of k is a sum of solutions of sparse systems.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu
from torch import Tensor

from uvcloth.geometry.mesh import WeldedMesh, face_normals, welded

Solve = Callable[[NDArray[Any]], NDArray[Any]]
"""Solution (n, C) of a sparse system with right-hand sides (n, C)."""

DIFFUSION_STEPS = 4
"""Implicit steps of the diffusion."""

POLES = np.exp(0.25j * np.pi * np.array([1.0, 3.0]))
"""Poles of 1 / (1 + s^4) in the upper half plane."""

THINNEST = 1e-12
"""Least area, m2, of a vertex, and by which a cotangent is divided."""


@dataclass(frozen=True)
class GarmentSurface:
    """A garment at rest.

    mesh: welded, of n points. areas: (n,) m2. laplacian: (n, n).
    """

    mesh: WeldedMesh
    areas: NDArray[np.float64]
    laplacian: csc_array

    def diffusion(self, width: float) -> Callable[[Tensor], Tensor]:
        """Averages of fields (B, n, C) over patches: a Gaussian with the standard deviation `width`, m."""
        time = 0.5 * width**2 / DIFFUSION_STEPS
        solve = _solver(diags_array(self.areas) + time * self.laplacian)

        def average(field: Tensor) -> Tensor:
            columns = _columns(field)
            for _ in range(DIFFUSION_STEPS):
                columns = solve(self.areas[:, None] * columns)
            return _fields(columns, field)

        return average

    def low_pass(self, wavelength: float) -> Callable[[Tensor], Tensor]:
        """Filter 1 / (1 + (k / k0)^8) of fields (B, n, C), with k0 = 2 pi / `wavelength`, m.

        That is 1 / (1 + s^4) of s = (k / k0)^2, a sum of shares p / (p - s) / 4 of its four poles p, of which
        two are the conjugates of the others.
        """
        scaled = self.laplacian * (wavelength / (2.0 * np.pi)) ** 2
        solves = [_solver(pole * diags_array(self.areas) - scaled) for pole in POLES]

        def filtered(field: Tensor) -> Tensor:
            columns = (self.areas[:, None] * _columns(field)).astype(complex)
            terms = [0.5 * (pole * solve(columns)).real for pole, solve in zip(POLES, solves, strict=True)]
            return _fields(sum(terms), field)

        return filtered


def make_surface(rest: Tensor, faces: Tensor) -> GarmentSurface:
    """The surface of a mesh at rest (N, 3) m with faces (M, 3)."""
    mesh = welded(rest, faces)
    corners, vertices, count = mesh.faces, mesh.points.double(), len(mesh.points)
    doubled = face_normals(vertices, corners).norm(dim=1).clamp(min=THINNEST)
    rows, columns, weights = [], [], []
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        start, end, opposite = (corners[:, corner] for corner in (a, b, c))
        first, second = vertices[start] - vertices[opposite], vertices[end] - vertices[opposite]
        rows += [start, end]
        columns += [end, start]
        weights += 2 * [0.5 * (first * second).sum(1) / doubled]
    places = (torch.cat(rows).numpy(), torch.cat(columns).numpy())
    adjacency = coo_array((torch.cat(weights).numpy(), places), shape=(count, count)).tocsc()
    areas = vertices.new_zeros(count).index_add(0, corners.flatten(), (doubled / 6.0).repeat_interleave(3))
    return GarmentSurface(
        mesh, areas.clamp(min=THINNEST).numpy(), (diags_array(adjacency.sum(1)) - adjacency).tocsc()
    )


def _solver(matrix: Any) -> Solve:
    """Solve with a sparse symmetric matrix, whose order keeps the factors small."""
    solve: Solve = splu(
        matrix.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    ).solve
    return solve


def _columns(field: Tensor) -> NDArray[np.float64]:
    """A field (B, n, C) as columns (n, B C)."""
    return field.double().transpose(0, 1).flatten(1).numpy()


def _fields(columns: NDArray[Any], like: Tensor) -> Tensor:
    """Columns (n, B C) as a field (B, n, C)."""
    return torch.from_numpy(np.ascontiguousarray(columns)).unflatten(1, (len(like), -1)).transpose(0, 1)
