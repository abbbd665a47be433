"""Smoothing of the blend shapes' gradient over garments, so that cloth sinks as a whole.

Gravity's part of the gradient is small at every vertex and the same over a whole garment; that of edges and
collisions is large and changes from one vertex to the next. Adam, which brings every number to one size,
follows the latter. A smoothed (Sobolev) gradient, as in Nicolet, Jacobson and Jakob 2021, "Large steps in
inverse rendering", points where the garment as a whole should go.
"""

from collections.abc import Sequence

import numpy as np
import torch
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import eigsh
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.geometry.mesh import unique_edges
from uvcloth.geometry.records import CPU

MODES = 200
"""Eigenvectors of each garment's Laplacian that the smooth part consists of."""

SPREAD = 100.0
"""Squared edge lengths over which a gradient is spread."""


class GradientSmoothing:
    """Smoothing of the gradient of blend shapes.

    faces: (F, 3) of each garment, into the U vertices of the outfit. share: of the smoothed gradient, 0 to 1.
    Raises InputError for another.
    """

    def __init__(self, faces: Sequence[Tensor], share: float, device: torch.device = CPU) -> None:
        if not 0.0 <= share <= 1.0:
            raise InputError(f"--smoothing {share}: expected a share from 0 to 1")
        self.share = share
        self.garments = []
        for part in faces if share else ():
            rows, corners = part.cpu().unique(return_inverse=True)
            values, modes = _modes(corners, len(rows))
            damping = 1.0 / (1.0 + SPREAD * values.clamp(min=0.0))
            self.garments.append((rows.to(device), modes.to(device), damping[:, None].to(device)))

    def __call__(self, gradient: Tensor) -> Tensor:
        """Gradient (W, 3 U) of W blend shapes, a share of it replaced by its smooth part at the same norm."""
        if not self.garments:
            return gradient
        width = len(gradient)
        given = gradient.view(width, -1, 3).transpose(0, 1).reshape(-1, 3 * width)
        smooth = torch.zeros_like(given)
        for rows, modes, damping in self.garments:
            smooth[rows] = modes @ (damping * (modes.T @ given[rows]))
        smooth *= given.norm() / smooth.norm().clamp(min=torch.finfo(smooth.dtype).tiny)
        mixed = torch.lerp(given, smooth, self.share)
        return mixed.view(-1, width, 3).transpose(0, 1).reshape(width, -1)


def _modes(faces: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Lowest eigenvalues (M,) and eigenvectors (count, M) of the uniform Laplacian of faces (F, 3)."""
    start, end = unique_edges(faces).numpy().T
    ends = (np.concatenate([start, end]), np.concatenate([end, start]))
    adjacency = coo_array((np.ones(len(ends[0])), ends), shape=(count, count)).tocsc()
    matrix = (diags_array(adjacency.sum(1)) - adjacency).tocsc()
    if count <= 2 * MODES:
        values, modes = np.linalg.eigh(matrix.toarray())
        values, modes = values[:MODES], modes[:, :MODES]
    else:
        # A fixed start, so that the same training gives the same bits.
        values, modes = eigsh(matrix, k=MODES, sigma=-1e-3, v0=np.cos(np.arange(count)))
    return torch.from_numpy(values).float(), torch.from_numpy(modes).float()
