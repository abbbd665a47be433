"""Self-intersection of cloth: the share of its edges that cross one of its faces."""

import torch
from torch import Tensor

from uvcloth.geometry.mesh import unique_edges
from uvcloth.physics import kernels
from uvcloth.physics.launch import array, launch
from uvcloth.physics.surface import MovingMeshes


def crossing_edges_percent(vertices: Tensor, faces: Tensor) -> Tensor:
    """Percent of a mesh's edges that run through one of its faces, per frame: (F,).

    vertices: (F, N, 3) m. faces: (M, 3). Runs on the device of the vertices.

    A face with a corner at an end of the edge does not count: neither do the two sides of a UV seam, as long
    as they lie together. Where they may part, pass faces that are joined there: `weld(rest)[faces]`.
    """
    percent = vertices.new_zeros(len(vertices))
    edges = unique_edges(faces).to(vertices.device, torch.int32).flatten()
    count = len(edges) // 2
    if not count or not len(vertices):
        return percent
    mesh = MovingMeshes(vertices[0], (faces,))
    crosses = edges.new_empty(count)
    arguments = (mesh.ids, array(mesh.points), array(edges), array(crosses))
    for frame, points in enumerate(vertices):
        mesh.update(points)
        launch(kernels.crossing_edges, count, vertices.device, *arguments)
        percent[frame] = 100.0 * crosses.float().mean()
    return percent
