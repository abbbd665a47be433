"""Linear blend skinning, and blend weights smoothed over a mesh."""

from functools import partial

import numpy as np
import torch
from torch import Tensor

from uvcloth.geometry.diffusion import averaging_shares, chebyshev_sum
from uvcloth.geometry.mesh import neighbour_average, unique_edges
from uvcloth.geometry.rotations import rotate_back

FEW = 8
"""Joints per frame from which on blending transforms costs less than one product with all weighted points."""


def blend_transforms(weights: Tensor, transforms: Tensor) -> Tensor:
    """Blend joint transforms per vertex: weights (V, J), transforms (B, J, 3, 4) -> (B, V, 3, 4)."""
    batch, joints = transforms.shape[:2]
    columns = transforms.permute(1, 0, 2, 3).reshape(joints, -1)
    return (weights @ columns).view(-1, batch, 3, 4).transpose(0, 1)


def apply_transforms(blended: Tensor, points: Tensor) -> Tensor:
    """Move points (V, 3) or (B, V, 3) by per-vertex transforms (B, V, 3, 4) -> (B, V, 3)."""
    return (blended[..., :3] * points.unsqueeze(-2)).sum(-1) + blended[..., 3]


def skin(points: Tensor, weights: Tensor, transforms: Tensor) -> Tensor:
    """Linear blend skinning: points (V, 3) at rest, weights (V, J), transforms (B, J, 3, 4) -> (B, V, 3).

    For many frames it is one matrix product, without the blended transforms of the vertices.
    """
    batch, joints = transforms.shape[:2]
    if FEW * batch <= joints:
        return apply_transforms(blend_transforms(weights, transforms), points)
    homogeneous = torch.cat([points, torch.ones_like(points[:, :1])], dim=1)
    weighted = (weights[:, :, None] * homogeneous[:, None, :]).flatten(1)
    columns = transforms.permute(1, 3, 0, 2).reshape(4 * joints, 3 * batch)
    return (weighted @ columns).view(-1, batch, 3).transpose(0, 1).contiguous()


def skin_each(points: Tensor, weights: Tensor, transforms: Tensor) -> Tensor:
    """Linear blend skinning of points that differ in every frame.

    points: (B, 3, V) at rest, coordinate by coordinate, so that all sums run along memory. weights (V, J),
    transforms (B, J, 3, 4) -> (B, V, 3).
    """
    batch, joints = transforms.shape[:2]
    entries = transforms.permute(2, 3, 0, 1).reshape(12 * batch, joints)
    blended = (entries @ weights.T).view(3, 4, batch, -1)
    posed = blended[:, 3]
    for axis in range(3):
        posed = torch.addcmul(posed, blended[:, axis], points[:, axis])
    return posed.permute(1, 2, 0)


def rotation_part(blended: Tensor) -> Tensor:
    """Orthonormal frames (..., 3, 3) nearest in the Gram-Schmidt sense to blended matrices (..., 3, 4).

    Columns are the images of the rest axes; the third is the reference, so blends stay well defined.
    """
    z = torch.nn.functional.normalize(blended[..., :, 2], dim=-1)
    x = blended[..., :, 0]
    x = torch.nn.functional.normalize(x - (x * z).sum(-1, keepdim=True) * z, dim=-1)
    return torch.stack([x, torch.linalg.cross(z, x), z], dim=-1)


def diffuse_weights(weights: Tensor, vertices: Tensor, faces: Tensor, distance: float) -> Tensor:
    """Blend weights (N, J) diffused over a mesh by about `distance` metres; rows still sum to one.

    n passes of averaging a vertex and the mean A of its neighbours, each of which spreads by about one edge
    length, are ((I + A) / 2)^n, a sum of Chebyshev polynomials of A.
    """
    edges = unique_edges(faces)
    length = (vertices[edges[:, 0]] - vertices[edges[:, 1]]).norm(dim=1).mean()
    passes = max(1, round(float((distance / length) ** 2)))
    average = neighbour_average(faces, len(vertices))
    spread = chebyshev_sum(partial(torch.sparse.mm, average), weights, averaging_shares(passes)).clamp(
        min=0.0
    )
    return spread / spread.sum(1, keepdim=True)


def skin_frames(points: Tensor, weights: Tensor, transforms: Tensor) -> tuple[Tensor, Tensor]:
    """Skinned points (B, N, 3) and frames (B, N, 3, 3), columns: the rest axes turned by the blend."""
    blended = blend_transforms(weights, transforms)
    return apply_transforms(blended, points), rotation_part(blended)


def seen_from_root(points: Tensor, transforms: Tensor) -> Tensor:
    """Points (B, P, 3) m in the axes of the root joint, the first of transforms (B, J, 3, 4)."""
    root = transforms[:, None, 0]
    return rotate_back(root[..., :3], points - root[..., 3])


def strongest(weights: Tensor, influences: int) -> tuple[np.ndarray, np.ndarray]:
    """Strongest blend weights of each vertex, rescaled to sum to one: (V, J) -> joints, weights (V, I).

    Influences without weight name joint 0.
    """
    top = weights.topk(min(influences, weights.shape[1]), dim=1)
    values = (top.values / top.values.sum(1, keepdim=True)).numpy().astype(np.float32)
    joints = np.where(values > 0, top.indices.numpy(), 0)
    missing = ((0, 0), (0, influences - values.shape[1]))
    return np.pad(joints, missing), np.pad(values, missing)
