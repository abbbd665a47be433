"""Cloth energies: stretch, bending, gravity, collision, pins; and measures of deformation. Differentiable.

The energies are those of PBNS (Bertiche et al. 2021, section 3.3) in joules; leading dimensions are poses or
frames. The measures in reports use the same lengths and normals.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies import frames
from uvcloth.geometry.mesh import edge_lengths, face_normals, face_pairs, unique_edges

GRAVITY = -frames.GRAVITY[2]
"""Acceleration of gravity, m/s2, downwards."""


@dataclass(frozen=True)
class RestShape:
    """Cloth at rest, as the energies need it.

    faces: (F, 3). edges: (E, 2) and lengths: (E,) m. pairs: (P, 2) faces that share an edge. masses: (N,) kg.
    """

    faces: Tensor
    edges: Tensor
    lengths: Tensor
    pairs: Tensor
    masses: Tensor


def rest_shape(vertices: Tensor, faces: Tensor, density: float) -> RestShape:
    """Cloth at rest: vertices (N, 3) m, faces (F, 3), density kg/m2; faces weigh on their corners."""
    edges = unique_edges(faces)
    areas = 0.5 * face_normals(vertices, faces).norm(dim=1)
    masses = vertices.new_zeros(len(vertices)).index_add(0, faces.flatten(), areas.repeat_interleave(3))
    return RestShape(faces, edges, edge_lengths(vertices, edges), face_pairs(faces), density / 3.0 * masses)


def edge_energy(vertices: Tensor, cloth: RestShape, stiffness: float) -> Tensor:
    """L_edge (PBNS eq. 4): vertices (..., N, 3) m, stiffness N/m -> (...,) J.

    stiffness times the sum of squared changes of edge length: each edge is a spring of twice that stiffness.
    """
    return stiffness * (edge_lengths(vertices, cloth.edges) - cloth.lengths).square().sum(-1)


def bend_energy(vertices: Tensor, cloth: RestShape, stiffness: float) -> Tensor:
    """L_bend (PBNS eq. 4): vertices (..., N, 3) m, stiffness J -> (...,) J.

    stiffness times the sum of squared differences between the normals of neighbouring faces, as the paper's
    program has its Laplace-Beltrami operator on face normals. Flat cloth has none, whatever its rest shape.
    """
    first, second = _neighbours(_normals(vertices, cloth.faces), cloth.pairs)
    return stiffness * (first - second).square().sum((-2, -1))


def gravity_energy(vertices: Tensor, cloth: RestShape) -> Tensor:
    """L_gravity (PBNS section 3.3): vertices (..., N, 3) m -> m g h, (...,) J, zero at the height z = 0."""
    return GRAVITY * (vertices[..., 2] * cloth.masses).sum(-1)


def collision_energy(distance: Tensor, thickness: float, stiffness: float) -> Tensor:
    """L_collision (PBNS eq. 5): signed distances (..., N) m from a surface, stiffness N/m -> (...,) J.

    stiffness times the sum of squared differences to thickness (m, the paper's epsilon) where it is not kept.
    """
    return stiffness * (thickness - distance).clamp(min=0).square().sum(-1)


def pin_energy(deformation: Tensor, stiffness: float) -> Tensor:
    """Pinning (PBNS section 3.3): deformations (..., n, 3) m of the pinned vertices, N/m -> (...,) J."""
    return stiffness * deformation.square().sum((-2, -1))


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
    return hinge_angles(vertices, faces).abs().mean(-1)


def fold_cosine(vertices: Tensor, faces: Tensor) -> Tensor:
    """Mean cosine distance between the normals of neighbouring faces: (..., N, 3), (F, 3) -> (...,).

    PBNS's measure "Bending" as section 4.4 defines it; its table calls it radians.
    """
    first, second = _neighbours(_normals(vertices, faces), face_pairs(faces))
    return 0.5 * (first - second).square().sum(-1).mean(-1)


def hinge_angles(vertices: Tensor, faces: Tensor) -> Tensor:
    """Signed angle between the normals at each of P interior edges, radians, positive where it folds outward.

    vertices: (..., N, 3). faces: (F, 3), consistently oriented. Returns (..., P) in (-pi, pi).
    """
    pairs = face_pairs(faces)
    first, second = _neighbours(_normals(vertices, faces), pairs)
    centres = _neighbours(vertices[..., faces, :].mean(-2), pairs)
    sine = _safe_norm(torch.linalg.cross(first, second))
    side = torch.sign(((second - first) * (centres[1] - centres[0])).sum(-1))
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


def _normals(vertices: Tensor, faces: Tensor) -> Tensor:
    return torch.nn.functional.normalize(face_normals(vertices, faces), dim=-1)


def _neighbours(values: Tensor, pairs: Tensor) -> tuple[Tensor, Tensor]:
    """Values of faces (..., F, C) at either side of P edges, (..., P, C) each."""
    return values[..., pairs[:, 0], :], values[..., pairs[:, 1], :]
