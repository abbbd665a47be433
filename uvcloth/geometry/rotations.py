"""Rotation matrices: applied to vectors, and to and from quaternions, axis-angles and Euler angles.

The conversions that need care are kornia's, and scipy's where files need them, imported where they are used:
kornia takes a second, which reading a clip and writing a rollout do not need.
"""

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
    from scipy.spatial.transform import Rotation

    matrices = rotations.detach().cpu().double().reshape(-1, 3, 3).numpy()
    quaternions = torch.from_numpy(Rotation.from_matrix(matrices).as_quat(canonical=True))
    return quaternions.to(rotations.device).view(*rotations.shape[:-2], 4)


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
    from kornia.geometry.conversions import rotation_matrix_to_axis_angle

    return rotation_matrix_to_axis_angle(rotations.reshape(-1, 3, 3)).view(*rotations.shape[:-2], 3)


def from_axis_angles(axis_angles: Tensor) -> Tensor:
    """Rotations (..., 3, 3) of axes times angles (..., 3), radians."""
    from kornia.geometry.conversions import axis_angle_to_rotation_matrix

    return axis_angle_to_rotation_matrix(axis_angles.reshape(-1, 3)).view(*axis_angles.shape[:-1], 3, 3)


def heading(rotations: Tensor) -> Tensor:
    """Rotations about the vertical (..., 3, 3) that are nearest to rotations (..., 3, 3)."""
    sine = rotations[..., 1, 0] - rotations[..., 0, 1]
    cosine = rotations[..., 0, 0] + rotations[..., 1, 1]
    return from_euler("z", torch.atan2(sine.double(), cosine.double())[..., None]).to(rotations)


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
