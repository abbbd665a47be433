"""Self-intersection of cloth: the share of its edges that cross one of its faces."""

import math

import numpy as np
from torch import Tensor

from uvcloth.geometry.mesh import unique_edges
from uvcloth.player.meshes import MovingMeshes


def crossing_edges_percent(vertices: Tensor, faces: Tensor) -> Tensor:
    """Percent of a mesh's edges that run through one of its faces, per frame: (F,); NaN where a vertex is
    not a finite number.

    vertices: (F, N, 3) m. faces: (M, 3).

    A face with a corner at an end of the edge does not count: neither do the two sides of a UV seam, as long
    as they lie together. Where they may part, pass faces that are joined there: `weld(rest)[faces]`.
    """
    edges = unique_edges(faces).cpu().numpy()
    if not len(edges) or not len(vertices):
        return vertices.new_zeros(len(vertices))
    frames = vertices.detach().cpu().numpy()
    mesh = MovingMeshes(frames[0], [faces.cpu().numpy()])
    shares = []
    for points in frames:
        if not np.isfinite(points).all():
            shares.append(math.nan)
            continue
        mesh.move(points)
        shares.append(100.0 * float(mesh.crossing_edges(0, edges).mean()))
    return vertices.new_tensor(shares)
