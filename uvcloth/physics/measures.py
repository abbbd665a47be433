"""Measures of deformed cloth: edges, folds, jitter. Differentiable; leading dimensions are poses."""

import torch
from torch import Tensor

from uvcloth.geometry.mesh import edge_lengths, face_pairs, hinges, unique_edges, unit_face_normals


def edge_change(vertices: Tensor, rest: Tensor, faces: Tensor) -> Tensor:
    """Mean absolute change of edge length against rest, metres: (..., N, 3), (N, 3), (F, 3) -> (...,).

    PBNS's measure "Edge": a compression counts like a stretch.
    """
    return length_change(vertices, rest, unique_edges(faces)).mean(-1)


def length_change(vertices: Tensor, rest: Tensor, edges: Tensor) -> Tensor:
    """Absolute change of the length of edges (E, 2), metres: (..., N, 3), (N, 3) -> (..., E)."""
    return (edge_lengths(vertices, edges) - edge_lengths(rest, edges)).abs()


def fold_angle(vertices: Tensor, faces: Tensor) -> Tensor:
    """Mean angle between the normals of neighbouring faces, radians: (..., N, 3), (F, 3) -> (...,).

    Zero where the cloth is flat, whatever its shape at rest.
    """
    return hinge_angles(vertices, hinges(faces)).abs().mean(-1)


def fold_cosine(vertices: Tensor, faces: Tensor) -> Tensor:
    """Mean cosine distance between the normals of neighbouring faces: (..., N, 3), (F, 3) -> (...,).

    PBNS's measure "Bending" as section 4.4 defines it; its table calls it radians.
    """
    return 0.5 * normal_differences(vertices, faces, face_pairs(faces)).mean(-1)


def hinge_angles(vertices: Tensor, corners: Tensor) -> Tensor:
    """Signed angle between the faces at each of P hinges, radians, positive where it folds outward.

    vertices: (..., N, 3). corners: (P, 4), see `hinges`. Returns (..., P) in (-pi, pi).
    """
    first, second, start, end = (vertices[..., corner, :] for corner in corners.unbind(1))
    normals = [
        torch.nn.functional.normalize(torch.linalg.cross(a, b), dim=-1)
        for a, b in ((start - first, end - first), (end - second, start - second))
    ]
    along = torch.nn.functional.normalize(end - start, dim=-1)
    sine = (torch.linalg.cross(normals[0], normals[1]) * along).sum(-1)
    return torch.atan2(sine, (normals[0] * normals[1]).sum(-1))


def normal_differences(vertices: Tensor, faces: Tensor, pairs: Tensor) -> Tensor:
    """Squared difference between the unit normals of each pair of faces: (..., N, 3) -> (..., P).

    faces: (F, 3). pairs: (P, 2) of them. It is 2 (1 - cos) of the angle between the normals.
    """
    normals = unit_face_normals(vertices, faces)
    return (normals[..., pairs[:, 0], :] - normals[..., pairs[:, 1], :]).square().sum(-1)


def acceleration_jitter(vertices: Tensor, fps: float) -> Tensor:
    """Mean length of the second difference in time, m/s2: vertices (T, N, 3) -> (T - 2,).

    It includes the acceleration of the motion itself: compare it with the simulation's.
    """
    return torch.diff(vertices, n=2, dim=0).norm(dim=-1).mean(-1) * fps**2
