"""Energy and viscous loss of the solver's cloth, written a second time, in float64 and differentiable."""

import torch
from torch import Tensor

from uvcloth.geometry.mesh import hinges
from uvcloth.physics.cloth.cloth import Damping
from uvcloth.physics.fabric import Fabric
from uvcloth.physics.measures import hinge_angles


def lame(fabric: Fabric) -> tuple[float, float]:
    """Shear modulus and first Lame parameter of plane stress, N/m."""
    return (
        fabric.stretch / (2.0 * (1.0 + fabric.poisson)),
        fabric.stretch * fabric.poisson / (1.0 - fabric.poisson**2),
    )


def membrane_energy(
    points: Tensor, rest: Tensor, faces: Tensor, fabric: Fabric, compression: float = 1.0
) -> Tensor:
    """Energy, J, of the principal strains at points (N, 3), Green's or Biot's; negative ones are reduced.

    The stretches come from the squared lengths of edges alone: from the sum and the product of their squares.
    """
    mu, spread = lame(fabric)
    ratio = torch.linalg.solve(_squares(rest, faces), _squares(points, faces))
    product = torch.linalg.det(ratio).sqrt()
    total = (_trace(ratio) + 2.0 * product).sqrt()
    apart = (total.square() - 4.0 * product).clamp(min=1e-24).sqrt()
    stretches = 0.5 * torch.stack([total + apart, total - apart], -1)
    strains = torch.where(stretches > 1.0, 0.5 * (stretches.square() - 1.0), stretches - 1.0)
    root = compression**0.5
    folding = root * strains - 0.5 * (1.0 - root) * strains.square()
    strains = torch.where(strains > 0.0, strains, folding)
    density = mu * strains.square().sum(-1) + 0.5 * spread * strains.sum(-1).square()
    return (_areas(rest, faces) * density).sum()


def hinge_energy(points: Tensor, rest: Tensor, faces: Tensor, fabric: Fabric) -> Tensor:
    """Energy, J, of the angles between neighbouring faces against those at rest."""
    corners = hinges(faces)
    turned = hinge_angles(points, corners) - hinge_angles(rest, corners)
    return 0.5 * (hinge_stiffness(rest, faces, fabric) * turned.square()).sum()


def hinge_stiffness(rest: Tensor, faces: Tensor, fabric: Fabric) -> Tensor:
    """Rigidity times squared length over the area of both faces, N m, of each pair of neighbours: (P,)."""
    first, second, start, end = rest[hinges(faces)].unbind(1)
    along = end - start
    doubled = torch.stack(
        [torch.linalg.cross(along, tip - start).norm(dim=1) for tip in (first, second)]
    ).sum(0)
    return fabric.bend * 2.0 * along.square().sum(1) / doubled


def stiffness_matrix(rest: Tensor, faces: Tensor, fabric: Fabric) -> Tensor:
    """Forces over small displacements from rest: (3 N, 3 N) N/m."""
    mu, spread = lame(fabric)
    strain, slopes = _strain_slopes(rest, faces), _hinge_slopes(rest, faces)
    trace, areas = strain[:, 0] + strain[:, 3], _areas(rest, faces)
    return (
        2.0 * mu * torch.einsum("f,fsa,fsb->ab", areas, strain, strain)
        + spread * torch.einsum("f,fa,fb->ab", areas, trace, trace)
        + torch.einsum("h,ha,hb->ab", hinge_stiffness(rest, faces, fabric), slopes, slopes)
    )


def damping_matrix(rest: Tensor, faces: Tensor, fabric: Fabric, damping: Damping) -> Tensor:
    """Viscous forces over velocities at rest: (3 N, 3 N) N s/m.

    Strain rates lose 2 (mu + lambda) damping.stretch of power per area and squared rate, angles their
    stiffness times damping.bend.
    """
    mu, spread = lame(fabric)
    strain, slopes = _strain_slopes(rest, faces), _hinge_slopes(rest, faces)
    viscosity = 2.0 * damping.stretch * (mu + spread) * _areas(rest, faces)
    stiffness = damping.bend * hinge_stiffness(rest, faces, fabric)
    return torch.einsum("f,fsa,fsb->ab", viscosity, strain, strain) + torch.einsum(
        "h,ha,hb->ab", stiffness, slopes, slopes
    )


def _strain_slopes(rest: Tensor, faces: Tensor) -> Tensor:
    """Derivatives (M, 4, 3 N) of the faces' strain at rest."""
    frames = torch.linalg.qr(_sides(rest, faces)).R.inverse()

    def strain(points: Tensor) -> Tensor:
        return 0.5 * frames.transpose(-1, -2) @ _squares(points.reshape(-1, 3), faces) @ frames

    slopes = torch.autograd.functional.jacobian(strain, rest.reshape(-1))
    return slopes.reshape(len(faces), 4, -1)


def _hinge_slopes(points: Tensor, faces: Tensor) -> Tensor:
    """Derivatives (P, 3 N) of angles."""
    corners = hinges(faces)
    slopes = torch.autograd.functional.jacobian(lambda moved: hinge_angles(moved, corners), points)
    return slopes.reshape(len(corners), -1)


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
