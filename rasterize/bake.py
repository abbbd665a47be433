"""Vertex attributes to maps: gathers and weighted sums, batched, differentiable, on any device."""

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


def valid_mask(texels: Texels) -> Tensor:
    """Mask of the texels that lie on a face: (H, W) bool."""
    mask = torch.zeros(texels.height * texels.width, dtype=torch.bool, device=texels.pixels.device)
    mask[texels.pixels] = True
    return mask.view(texels.height, texels.width)
