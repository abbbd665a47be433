"""Closest points on triangles, one triangle for each point."""

import torch
from torch import Tensor


def closest_barycentrics(points: Tensor, triangles: Tensor) -> Tensor:
    """Barycentrics (K, 3) of the closest point on each of K triangles (K, 3, 3) m to points (K, 3) m.

    It is the foot on the plane, where that is inside, or else the closest point on the three edges.
    """
    inside = _foot(points, triangles)
    start, end = triangles, triangles.roll(-1, 1)
    along = end - start
    length = along.square().sum(-1).clamp(min=torch.finfo(points.dtype).tiny)
    share = (((points[:, None] - start) * along).sum(-1) / length).clamp(0.0, 1.0)
    corners = torch.eye(3).to(points)
    edges = torch.lerp(corners, corners.roll(-1, 0), share[..., None])
    candidates = torch.cat([inside[:, None], edges], dim=1)
    distance = (candidates @ triangles - points[:, None]).norm(dim=-1)
    distance[:, 0] = torch.where((inside >= 0.0).all(1), distance[:, 0], torch.inf)
    best = distance.argmin(1)
    return candidates[torch.arange(len(points)), best]


def _foot(points: Tensor, triangles: Tensor) -> Tensor:
    """Barycentrics (K, 3) of the foot of points on the planes of triangles; not finite without an area."""
    sides = triangles[:, 1:] - triangles[:, :1]
    (uu, uv), (_, vv) = (row.unbind(-1) for row in (sides @ sides.mT).unbind(1))
    up, vp = (sides @ (points - triangles[:, 0])[..., None]).squeeze(-1).unbind(-1)
    area = uu * vv - uv * uv
    second, third = (vv * up - uv * vp) / area, (uu * vp - uv * up) / area
    return torch.stack([1.0 - second - third, second, third], dim=-1)
