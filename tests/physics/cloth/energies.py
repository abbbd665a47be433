"""Energy and viscous loss of the solver's cloth, written a second time, in float64 and differentiable."""

import torch
from torch import Tensor

from uvcloth.geometry.mesh import face_pairs
from uvcloth.physics.cloth.cloth import Damping
from uvcloth.physics.energies import hinge_angles
from uvcloth.physics.fabric import Fabric


def lame(fabric: Fabric) -> tuple[float, float]:
    """Shear modulus and first Lame parameter of plane stress, N/m."""
    return (
        fabric.stretch / (2.0 * (1.0 + fabric.poisson)),
        fabric.stretch * fabric.poisson / (1.0 - fabric.poisson**2),
    )


def membrane_energy(
    points: Tensor, rest: Tensor, faces: Tensor, fabric: Fabric, compression: float = 1.0
) -> Tensor:
    """Energy, J, of Saint Venant and Kirchhoff at points (N, 3); negative principal strains are reduced.

    The principal stretches come from the squared lengths of edges alone.
    """
    mu, spread = lame(fabric)
    strain = 0.5 * (torch.linalg.solve(_squares(rest, faces), _squares(points, faces)) - torch.eye(2))
    trace, squares = _trace(strain), _trace(strain @ strain)
    if compression != 1.0:
        apart = (0.5 * squares - 0.25 * trace.square()).sqrt()
        principal = torch.stack([0.5 * trace + apart, 0.5 * trace - apart], -1)
        principal = torch.where(principal < 0.0, compression**0.5 * principal, principal)
        trace, squares = principal.sum(-1), principal.square().sum(-1)
    return (_areas(rest, faces) * (mu * squares + 0.5 * spread * trace.square())).sum()


def hinge_energy(points: Tensor, rest: Tensor, faces: Tensor, fabric: Fabric) -> Tensor:
    """Energy, J, of the angles between neighbouring faces against those at rest."""
    turned = hinge_angles(points, faces) - hinge_angles(rest, faces)
    return 0.5 * (hinge_stiffness(rest, faces, fabric) * turned.square()).sum()


def hinge_stiffness(rest: Tensor, faces: Tensor, fabric: Fabric) -> Tensor:
    """Rigidity times squared length over the area of both faces, N m, of each pair of neighbours: (P,)."""
    pairs = face_pairs(faces)
    shared = (faces[pairs[:, 0], :, None] == faces[pairs[:, 1], None, :]).any(2)
    start, end = rest[faces[pairs[:, 0]][shared].reshape(-1, 2)].unbind(1)
    return fabric.bend * (end - start).square().sum(1) / _areas(rest, faces)[pairs].sum(1)


def stiffness_matrix(points: Tensor, rest: Tensor, faces: Tensor, fabric: Fabric) -> Tensor:
    """Forces over displacements (3 N, 3 N), N/m, of a level sheet stretched level to points (N, 3)."""
    flat = rest.double()
    plane = torch.autograd.functional.hessian(
        lambda moved: membrane_energy(moved.reshape(-1, 3), flat, faces, fabric), points.double().reshape(-1)
    )
    slopes = _hinge_slopes(points.double(), faces)
    return plane + slopes.T @ (hinge_stiffness(flat, faces, fabric)[:, None] * slopes)


def damping_matrix(rest: Tensor, faces: Tensor, fabric: Fabric, damping: Damping) -> Tensor:
    """Viscous forces over velocities at rest: (3 N, 3 N) N s/m.

    Strain rates lose 2 (mu + lambda) damping.stretch of power per area and squared rate, angles their
    stiffness times damping.bend.
    """
    mu, spread = lame(fabric)
    flat = rest.double()
    frames = torch.linalg.qr(_sides(flat, faces)).R.inverse()

    def strains(moved: Tensor) -> Tensor:
        return 0.5 * frames.transpose(-1, -2) @ _squares(moved.reshape(-1, 3), faces) @ frames

    strain = torch.autograd.functional.jacobian(strains, flat.reshape(-1)).reshape(4 * len(faces), -1)
    viscosity = 2.0 * damping.stretch * (mu + spread) * _areas(flat, faces).repeat_interleave(4)
    slopes = _hinge_slopes(flat, faces)
    stiffness = damping.bend * hinge_stiffness(flat, faces, fabric)
    return strain.T @ (viscosity[:, None] * strain) + slopes.T @ (stiffness[:, None] * slopes)


def _hinge_slopes(points: Tensor, faces: Tensor, shift: float = 1e-6) -> Tensor:
    """Derivatives (P, 3 N) of angles, by differences: where cloth is flat, autograd has none."""
    moves = shift * torch.eye(points.numel(), dtype=points.dtype).reshape(-1, *points.shape)
    ahead, behind = hinge_angles(points + moves, faces), hinge_angles(points - moves, faces)
    return ((ahead - behind) / (2.0 * shift)).T


def _trace(matrices: Tensor) -> Tensor:
    return matrices.diagonal(dim1=-2, dim2=-1).sum(-1)


def _sides(points: Tensor, faces: Tensor) -> Tensor:
    a, b, c = points[..., faces, :].unbind(-2)
    return torch.stack([b - a, c - a], -1)


def _squares(points: Tensor, faces: Tensor) -> Tensor:
    sides = _sides(points, faces)
    return sides.transpose(-1, -2) @ sides


def _areas(points: Tensor, faces: Tensor) -> Tensor:
    return 0.5 * torch.linalg.det(_squares(points, faces)).sqrt()
