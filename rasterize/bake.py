"""Vertex attributes to maps and back: gathers and weighted sums, batched, differentiable, on any device."""

from dataclasses import dataclass

import torch
from torch import Tensor

from rasterize.gather import gather
from rasterize.texels import Texels


def bake(values: Tensor, faces: Tensor, texels: Texels) -> Tensor:
    """Interpolate vertex attributes at the texels (PhysXNet eq. 5): (..., V, C) -> (..., M, C).

    faces: (F, 3) int64 of the mesh. Everything on one device.
    """
    return gather(values, faces[texels.face], texels.barycentrics)


def scatter_map(texel_values: Tensor, texels: Texels) -> Tensor:
    """Put texel values on the sheet, zero elsewhere: (..., M, C) -> (..., C, H, W)."""
    columns = texel_values.transpose(-1, -2)
    sheet = columns.new_zeros(*columns.shape[:-1], texels.height * texels.width)
    sheet = sheet.index_copy(-1, texels.pixels, columns)
    return sheet.view(*columns.shape[:-1], texels.height, texels.width)


def gather_map(maps: Tensor, texels: Texels) -> Tensor:
    """Read the valid texels of maps: (..., C, H, W) -> (..., M, C)."""
    return maps.flatten(-2).index_select(-1, texels.pixels).transpose(-1, -2)


def valid_mask(texels: Texels) -> Tensor:
    """Mask of the texels that lie on a face: (H, W) bool."""
    mask = torch.zeros(texels.height * texels.width, dtype=torch.bool, device=texels.pixels.device)
    mask[texels.pixels] = True
    return mask.view(texels.height, texels.width)


@dataclass(frozen=True)
class Gutter:
    """Source texel of each texel of an H x W sheet: (H * W,) int64; valid ones copy themselves."""

    source: Tensor


def nearest_gutter(mask: Tensor, reach: float = float("inf")) -> Gutter:
    """Let the texels outside a mask (H, W) bool copy the nearest inside, up to `reach` texels away."""
    from scipy.ndimage import distance_transform_edt

    distance, nearest = distance_transform_edt(~mask.cpu().numpy(), return_indices=True)
    source = torch.from_numpy(nearest[0] * mask.shape[1] + nearest[1]).long()
    itself = torch.arange(mask.numel()).view(mask.shape)
    source = torch.where(torch.from_numpy(distance <= reach), source, itself)
    return Gutter(source.flatten().to(mask.device))


def fill_gutter(maps: Tensor, gutter: Gutter) -> Tensor:
    """Fill the texels between the charts of maps (..., H, W), so that convolutions see no edge there."""
    return maps.flatten(-2).index_select(-1, gutter.source).view_as(maps)
