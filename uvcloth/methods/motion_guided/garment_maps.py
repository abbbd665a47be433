"""A garment laid out on maps of its own texture coordinates, as the networks of Motion-guided read it."""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from rasterize.bake import scatter_map, valid_mask
from rasterize.decode import sample_points
from rasterize.gather import gather
from rasterize.texels import Texels, rasterize_layout
from uvcloth.garments.garment import Garment
from uvcloth.garments.layout import own_layout
from uvcloth.geometry.mesh import Mesh, vertex_normals
from uvcloth.methods.motion_guided.latent import uv_encoding
from uvcloth.methods.motion_guided.seeds import Kernels, Seeds, nearest_kernels

Skinning = Literal["smooth_lbs", "fixed", "kernels"]
"""The skinning of shapes at rest: by the smooth blend weights, or by Gaussian kernels around the seeds,
evaluated at a vertex's rest position (fixed) or at its displaced position (kernels, as published).
"""


@dataclass(frozen=True)
class GarmentMaps:
    """A garment at rest on a body, as the networks read it: fixed from frame to frame.

    sheet: its P texels. corners: (P, 3) vertices around each. mask: (1, 1, H, W). points: (N, 3) m at rest;
    axes: (N, 3, 3) local frames there. pixels, shares: (N, K) samples of the decoded map. places: (N, C)
    encoded texture coordinates. kernels: of the seeds near each vertex. smooth_weights: (N, J). skinning: the
    one that poses the garment. texel_points: (P, 3) m at rest, and texel_weights: (P, J), of the smooth LBS
    reference at the texels.
    """

    sheet: Texels
    corners: Tensor
    mask: Tensor
    points: Tensor
    axes: Tensor
    pixels: Tensor
    shares: Tensor
    places: Tensor
    kernels: Kernels
    seeds: Seeds
    smooth_weights: Tensor
    skinning: Skinning
    texel_points: Tensor
    texel_weights: Tensor

    def positions(self, vertices: Tensor) -> Tensor:
        """Values of garment vertices (B, N, 3) at the texels: (B, P, 3)."""
        return gather(vertices, self.corners, self.sheet.barycentrics)

    def sample(self, decoded: Tensor) -> Tensor:
        """Values of decoded maps (B, 4 H W, C) at the vertices: (B, N, C)."""
        return gather(decoded, self.pixels, self.shares)

    def map(self, values: Tensor) -> Tensor:
        """Texel values (B, P, C) as maps (B, C, H, W), zero off the charts."""
        return scatter_map(values, self.sheet)


def garment_maps(garment: Garment, seeds: Seeds, size: int, near: int, skinning: Skinning) -> GarmentMaps:
    """Lay a garment out on size x size maps; one without texture coordinates is unwrapped first.

    near: how many seeds may move a vertex.
    """
    mesh = garment.mesh
    layout = own_layout(mesh)
    sheet, fine = (rasterize_layout(layout, size) for size in (size, 2 * size))
    face, corner = _a_corner_of_each(mesh)
    corners, barycentrics = mesh.faces[sheet.face], sheet.barycentrics
    at_vertex = torch.nn.functional.one_hot(corner, 3).float()
    sampler = sample_points(layout, fine, mesh.faces, face, at_vertex)
    return GarmentMaps(
        sheet=sheet,
        corners=corners,
        mask=valid_mask(sheet).float()[None, None],
        points=mesh.vertices,
        axes=local_axes(mesh),
        pixels=sampler.pixels,
        shares=sampler.weights,
        places=uv_encoding(layout.uvs[layout.face_uvs[face, corner]]),
        kernels=nearest_kernels(mesh.vertices, seeds, near),
        seeds=seeds,
        smooth_weights=garment.smooth_weights,
        skinning=skinning,
        texel_points=gather(mesh.vertices, corners, barycentrics),
        texel_weights=gather(garment.smooth_weights, corners, barycentrics),
    )


def local_axes(mesh: Mesh) -> Tensor:
    """H_0: columns tangent, bitangent and normal at each vertex (N, 3, 3), the tangent level."""
    normals = vertex_normals(mesh.vertices, mesh.faces)
    level = torch.stack([-normals[:, 1], normals[:, 0], 0.0 * normals[:, 0]], dim=1)
    steep = level.norm(dim=1, keepdim=True) < 1e-3
    level = torch.where(steep, level.new_tensor([1.0, 0.0, 0.0]), level)
    tangent = torch.nn.functional.normalize(level - (level * normals).sum(1, keepdim=True) * normals, dim=1)
    return torch.stack([tangent, torch.linalg.cross(normals, tangent), normals], dim=2)


def _a_corner_of_each(mesh: Mesh) -> tuple[Tensor, Tensor]:
    """For every vertex a face (N,) that has it and which of its corners (N,) it is."""
    corner = torch.zeros(len(mesh.vertices), dtype=torch.int64)
    corner[mesh.faces.flatten()] = torch.arange(mesh.faces.numel())
    return corner // 3, corner % 3
