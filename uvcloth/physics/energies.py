"""How far cloth is from its rest shape, and how steadily it moves: measures that are also differentiable."""

import torch
from torch import Tensor

from uvcloth.mesh import edge_lengths, face_normals, face_pairs, unique_edges


def edge_change(vertices: Tensor, rest: Tensor, faces: Tensor) -> Tensor:
    """Mean absolute change of edge length against rest, metres: (..., N, 3), (N, 3), (F, 3) -> (...,).

    PBNS's measure "Edge": a compression counts like a stretch.
    """
    edges = unique_edges(faces)
    return (edge_lengths(vertices, edges) - edge_lengths(rest, edges)).abs().mean(-1)


def fold_angle(vertices: Tensor, faces: Tensor) -> Tensor:
    """Mean angle between the normals of neighbouring faces, radians: (..., N, 3), (F, 3) -> (...,).

    PBNS's measure "Bend": zero where the cloth is flat, whatever its shape at rest.
    """
    return hinge_angles(vertices, faces).abs().mean(-1)


def hinge_angles(vertices: Tensor, faces: Tensor) -> Tensor:
    """Signed angle between the normals at each of P interior edges, radians, positive where it folds outward.

    vertices: (..., N, 3). faces: (F, 3), consistently oriented. Returns (..., P) in (-pi, pi).
    """
    pairs = face_pairs(faces)
    normals = torch.nn.functional.normalize(face_normals(vertices, faces), dim=-1)
    centres = vertices[..., faces, :].mean(-2)
    first, second = normals[..., pairs[:, 0], :], normals[..., pairs[:, 1], :]
    apart = centres[..., pairs[:, 1], :] - centres[..., pairs[:, 0], :]
    sine = _safe_norm(torch.linalg.cross(first, second))
    side = torch.sign(((second - first) * apart).sum(-1))
    return torch.where(side < 0, -1.0, 1.0) * torch.atan2(sine, (first * second).sum(-1))


def acceleration_jitter(vertices: Tensor, fps: float) -> Tensor:
    """Mean length of the second difference in time, m/s2: vertices (T, N, 3) -> (T - 2,).

    It holds the motion's own acceleration too: compare it with the simulation's.
    """
    return torch.diff(vertices, n=2, dim=0).norm(dim=-1).mean(-1) * fps**2


def _safe_norm(vectors: Tensor) -> Tensor:
    """Lengths (...,) whose gradient at zero is zero instead of not a number."""
    square = (vectors * vectors).sum(-1)
    positive = square > 0
    return torch.where(positive, torch.where(positive, square, 1.0).sqrt(), 0.0)
