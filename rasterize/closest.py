"""Closest points on a mesh with warp; kept out of raycast.py, because importing warp takes a while."""

# mypy: disable-error-code="valid-type, attr-defined, no-untyped-call"

import numpy as np
import warp as wp
from torch import Tensor

from rasterize.warp_start import start_warp

start_warp()

UNBOUNDED_DISTANCE = 1e3
"""Distance, m, beyond any input that is accepted."""


@wp.kernel
def _closest(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    face: wp.array(dtype=int),
    barycentrics: wp.array(dtype=wp.vec3),
    distance: wp.array(dtype=float),
) -> None:
    i = wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, points[i], UNBOUNDED_DISTANCE)
    face[i] = query.face
    barycentrics[i] = wp.vec3(query.u, query.v, 1.0 - query.u - query.v)
    distance[i] = wp.length(points[i] - wp.mesh_eval_position(mesh, query.face, query.u, query.v))


def closest_on_mesh(points: Tensor, vertices: Tensor, faces: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Closest face (R,), barycentrics (R, 3) and distance (R,) metres on the CPU, for points (R, 3)."""
    count = len(points)
    with wp.ScopedDevice("cpu"):
        mesh = wp.Mesh(
            wp.array(np.ascontiguousarray(vertices.float().numpy()), dtype=wp.vec3),
            wp.array(faces.int().flatten().numpy(), dtype=wp.int32),
        )
        face = wp.zeros(count, dtype=wp.int32)
        barycentrics = wp.zeros(count, dtype=wp.vec3)
        distance = wp.zeros(count, dtype=wp.float32)
        wp.launch(
            _closest,
            dim=count,
            inputs=[mesh.id, wp.array(np.ascontiguousarray(points.float().numpy()), dtype=wp.vec3)],
            outputs=[face, barycentrics, distance],
        )
        return wp.to_torch(face), wp.to_torch(barycentrics), wp.to_torch(distance)
