"""Cloth that hardly stretches: the vertices nearest to given ones whose edges have their rest length."""

from typing import Any

import numpy as np
import scipy.sparse
import torch
from scipy.sparse.linalg import splu
from torch import Tensor

from uvcloth.mesh import unique_edges, weld


class Inextensible:
    """Projects a garment onto its rest edge lengths by alternating local and global steps.

    It minimizes |x - x0|^2 + stiffness * sum over edges |x_i - x_j - l_ij d_ij|^2, with d_ij the direction of
    the edge a step before (Bouaziz et al. 2014, Projective Dynamics), about the middle of each frame for the
    sake of float32. The matrix is the same for every step and frame and is factorized once. Vertices at one
    place at rest (UV seams) are one.

    vertices: (N, 3) at rest, m. faces: (M, 3). stiffness: against 1 for every vertex's place. passes: steps.
    """

    def __init__(self, vertices: Tensor, faces: Tensor, stiffness: float, passes: int) -> None:
        self.owner = weld(vertices)
        self.edges = unique_edges(self.owner[faces])
        ends = vertices[self.edges[:, 0]] - vertices[self.edges[:, 1]]
        self.lengths = ends.norm(dim=1, keepdim=True)
        self.passes = passes
        count, rows = len(vertices), np.arange(len(self.edges)).repeat(2)
        signs = np.tile(np.array([1.0, -1.0], np.float32), len(self.edges))
        difference = scipy.sparse.csr_matrix(
            (signs, (rows, self.edges.numpy().ravel())), (len(self.edges), count)
        )
        self.pull: Any = stiffness * difference.T.tocsr()
        matrix = scipy.sparse.identity(count, np.float32) + self.pull @ difference
        # The order that suits a symmetric matrix, without pivoting: it is diagonally dominant.
        self.factor = splu(
            matrix.tocsc().astype(np.float32),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    def project(self, vertices: Tensor) -> Tensor:
        """Move B frames of the garment (B, N, 3), m; the result is on the device of the input."""
        device, batch = vertices.device, len(vertices)
        moved = vertices.cpu()[:, self.owner]
        middle = moved.mean(dim=1, keepdim=True)
        moved = moved - middle
        place = _columns(moved)
        for _ in range(self.passes):
            ends = moved[:, self.edges[:, 0]] - moved[:, self.edges[:, 1]]
            wanted = ends * (self.lengths / ends.norm(dim=-1, keepdim=True).clamp(min=1e-9))
            solved = self.factor.solve(place + self.pull @ _columns(wanted))
            moved = torch.from_numpy(solved).view(-1, batch, 3).transpose(0, 1)
        return (moved + middle)[:, self.owner].to(device)


def _columns(values: Tensor) -> np.ndarray:
    """(B, R, 3) -> (R, B * 3), one right-hand side a column."""
    return values.transpose(0, 1).reshape(values.shape[1], -1).float().numpy()
