"""Rotation matrices: applied to vectors, and to and from quaternions, axis-angles and Euler angles."""

import math

import torch
from torch import Tensor


def rotate(frames: Tensor, vectors: Tensor) -> Tensor:
    """Local vectors to world: frames (..., 3, 3), vectors (..., 3)."""
    return (frames * vectors.unsqueeze(-2)).sum(-1)


def rotate_back(frames: Tensor, vectors: Tensor) -> Tensor:
    """World vectors to local: frames (..., 3, 3), vectors (..., 3)."""
    return (frames * vectors.unsqueeze(-1)).sum(-2)


def to_quaternions(rotations: Tensor) -> Tensor:
    """Unit quaternions x, y, z, w of rotations (..., 3, 3): (..., 4), in float64."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (row.unbind(-1) for row in rotations.double().unbind(-2))
    # Four times the products of all components; each row is the quaternion times one of them.
    products = torch.stack(
        [
            torch.stack([1 + xx - yy - zz, xy + yx, xz + zx, zy - yz], dim=-1),
            torch.stack([xy + yx, 1 - xx + yy - zz, yz + zy, xz - zx], dim=-1),
            torch.stack([xz + zx, yz + zy, 1 - xx - yy + zz, yx - xy], dim=-1),
            torch.stack([zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz], dim=-1),
        ],
        dim=-2,
    )
    # A component that is far from zero: w for angles up to 120 degrees, else the greatest of the others.
    far = torch.stack([xx, yy, zz], dim=-1).argmax(-1)
    row = torch.where(xx + yy + zz > 0, 3, far)[..., None, None].expand(*far.shape, 1, 4)
    return torch.nn.functional.normalize(products.gather(-2, row).squeeze(-2), dim=-1)


def from_quaternions(quaternions: Tensor) -> Tensor:
    """Rotations (..., 3, 3) of quaternions x, y, z, w of any length above zero, (..., 4)."""
    x, y, z, w = quaternions.unbind(-1)
    none = torch.zeros_like(w)
    cross = torch.stack([none, -z, y, z, none, -x, -y, x, none], dim=-1).unflatten(-1, (3, 3))
    scale = 2.0 / quaternions.square().sum(-1)[..., None, None]
    return torch.eye(3).to(cross) + scale * (w[..., None, None] * cross + cross @ cross)


def are_unit(quaternions: Tensor) -> bool:
    """Test that quaternions (..., 4), from a file, are of length one, within a thousandth."""
    return bool(((quaternions.double().norm(dim=-1) - 1.0).abs() < 1e-3).all())


def to_axis_angles(rotations: Tensor) -> Tensor:
    """Axes times angles, radians, of rotations (..., 3, 3): (..., 3)."""
    quaternions = to_quaternions(rotations)
    axis, cosine = quaternions[..., :3], quaternions[..., 3:]
    sine = axis.norm(dim=-1, keepdim=True)
    # The shorter way round. As the angle goes to zero, angle / sine goes to two.
    angle = 2 * torch.atan2(torch.where(cosine < 0, -sine, sine), cosine.abs())
    return (axis * torch.where(sine > 0, angle / sine, 2.0)).to(rotations)


def from_axis_angles(axis_angles: Tensor) -> Tensor:
    """Rotations (..., 3, 3) of axes times angles (..., 3), radians."""
    angle = axis_angles.norm(dim=-1, keepdim=True)
    # sin(angle / 2) / angle, also at zero.
    share = 0.5 * torch.sinc(angle / (2 * math.pi))
    return from_quaternions(torch.cat([share * axis_angles, (0.5 * angle).cos()], dim=-1))


def from_euler(axes: str, angles: Tensor) -> Tensor:
    """Product of turns about axes ("zyx": about z, then about the turned y and x), in the listed order.

    angles: (..., len(axes)) radians -> (..., 3, 3).
    """
    product = torch.eye(3).to(angles).expand(*angles.shape[:-1], 3, 3)
    for axis, angle in zip(axes, angles.unbind(-1), strict=True):
        product = product @ _about("xyz".index(axis), angle)
    return product


def _about(axis: int, angle: Tensor) -> Tensor:
    """Rotations (..., 3, 3) about one coordinate axis by angles (...)."""
    turned, across = (axis + 1) % 3, (axis + 2) % 3
    rotation = torch.eye(3).to(angle).repeat(*angle.shape, 1, 1)
    rotation[..., turned, turned] = rotation[..., across, across] = angle.cos()
    rotation[..., across, turned] = angle.sin()
    rotation[..., turned, across] = -angle.sin()
    return rotation


def smallest_rotation(source: Tensor, target: Tensor) -> Tensor:
    """Rotation (3, 3) by the smallest angle that takes one unit vector (3,) to another."""
    axis = torch.linalg.cross(source, target)
    x, y, z = axis.tolist()
    cross = torch.tensor([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]).to(source)
    return torch.eye(3).to(source) + cross + cross @ cross / (1.0 + source @ target).clamp(min=1e-6)
