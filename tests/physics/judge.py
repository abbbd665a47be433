"""What another library, ipctk, says of meshes that run through themselves or one another."""

from typing import Any

import ipctk
import numpy as np
import torch
from torch import Tensor


def crossing_percent(vertices: Tensor, faces: Tensor) -> float:
    """Percent of the edges of a mesh (N, 3), (M, 3) that run through one of its faces."""
    points, corners, edges = _arrays(vertices, faces)
    broad = ipctk.LBVH()
    broad.build(points, edges, corners, 0.0)
    crossing = {
        pair.edge_id
        for pair in broad.detect_edge_face_candidates()
        if ipctk.is_edge_intersecting_triangle(*points[edges[pair.edge_id]], *points[corners[pair.face_id]])
    }
    return 100.0 * len(crossing) / len(edges)


def meets_itself(vertices: Tensor, faces: Tensor) -> bool:
    """Whether an edge of a mesh runs through one of its faces."""
    points, corners, edges = _arrays(vertices, faces)
    return bool(ipctk.has_intersections(ipctk.CollisionMesh(points, edges, corners), points))


def meet(first: tuple[Tensor, Tensor], second: tuple[Tensor, Tensor]) -> bool:
    """Whether two meshes, vertices and faces of each, run through one another."""
    return bool(ipctk.has_intersections(*_both(first, second)))


def distance(first: tuple[Tensor, Tensor], second: tuple[Tensor, Tensor], reach: float) -> float:
    """Metres between two meshes that do not meet, infinite beyond the reach."""
    mesh, points = _both(first, second)
    near = ipctk.NormalCollisions()
    near.build(mesh, points, reach)
    return float(near.compute_minimum_distance(mesh, points)) ** 0.5


def _both(first: tuple[Tensor, Tensor], second: tuple[Tensor, Tensor]) -> tuple[Any, np.ndarray]:
    """Two meshes as one of which only the one may meet the other."""
    offset = len(first[0])
    points, corners, edges = _arrays(
        torch.cat([first[0], second[0]]), torch.cat([first[1], second[1] + offset])
    )
    mesh = ipctk.CollisionMesh(points, edges, corners)
    owners = (np.arange(len(points)) >= offset).astype(np.int32)
    mesh.can_collide = ipctk.make_vertex_patches_filter(owners)
    return mesh, points


def _arrays(vertices: Tensor, faces: Tensor) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    corners = faces.int().numpy()
    return np.asfortranarray(vertices.double().numpy()), corners, ipctk.edges(corners)
