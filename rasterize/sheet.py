"""Maps of one simulated sequence, for viewing and for other programs: motion of the body, offset of the
garment.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from rasterize.bake import bake, scatter_map
from rasterize.raycast import Hits, body_to_garment
from rasterize.texels import Texels

GARMENT_RAY_LENGTH = 0.12
"""Metres along the body's normal within which a texel's ray may meet cloth."""

AXES = ("X", "Y", "Z")


@dataclass(frozen=True)
class FrameMaps:
    """Maps of one frame, zero where the mask is, vectors along the world's axes.

    velocity: (3, H, W) m/s. acceleration: (3, H, W) m/s2. offset: (3, H, W) m from the body to the garment.
    body, garment: (H, W) masks, one where a texel sees the body or the garment.
    """

    velocity: Tensor
    acceleration: Tensor
    offset: Tensor
    body: Tensor
    garment: Tensor

    def channels(self) -> dict[str, np.ndarray]:
        """Named channels for an EXR file."""
        named = {"mask.body": self.body, "mask.garment": self.garment}
        for name in ("velocity", "acceleration", "offset"):
            named |= {f"{name}.{axis}": getattr(self, name)[i] for i, axis in enumerate(AXES)}
        return {name: values.numpy() for name, values in named.items()}


def see_garment(
    body_rest: Tensor, faces: Tensor, garment_rest: Tensor, garment_faces: Tensor, texels: Texels
) -> Hits:
    """T^BC in rest pose: the garment point of each of M texels.

    body_rest: (V, 3) m. garment_rest: (N, 3) m.
    """
    corners = body_rest[faces]
    across = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = torch.zeros_like(body_rest).index_add(0, faces.flatten(), across.repeat_interleave(3, dim=0))
    points, directions = bake(body_rest, faces, texels), bake(normals, faces, texels)
    return body_to_garment(points, directions, garment_rest, garment_faces, GARMENT_RAY_LENGTH)


def frame_maps(
    body: Tensor,
    faces: Tensor,
    garment: Tensor,
    garment_faces: Tensor,
    *,
    hits: Hits,
    texels: Texels,
    fps: float,
) -> FrameMaps:
    """Maps of the last of three frames (PhysXNet eq. 5 to 8, with differences per second).

    body: (3, V, 3) at frames k-2, k-1 and k. garment: (N, 3) at frame k. hits: of `see_garment`.
    """
    points = bake(body, faces, texels)
    velocity = (points[1:] - points[:-1]) * fps
    offset = torch.where(hits.hit[:, None], hits.interpolate(garment, garment_faces) - points[-1], 0.0)
    ones = torch.ones(len(texels), 1)
    return FrameMaps(
        velocity=scatter_map(velocity[-1], texels),
        acceleration=scatter_map((velocity[1] - velocity[0]) * fps, texels),
        offset=scatter_map(offset, texels),
        body=scatter_map(ones, texels)[0],
        garment=scatter_map(hits.hit[:, None].float(), texels)[0],
    )


def contact_sheet(frames: Mapping[int, FrameMaps]) -> np.ndarray:
    """Picture of one row per frame with velocity, acceleration and offset: (rows, columns, 3) in [0, 1].

    Grey is zero, red, green and blue are X, Y and Z; each quantity has one scale over all frames.
    """
    columns = []
    for name in ("velocity", "acceleration", "offset"):
        values = torch.stack([getattr(maps, name) for maps in frames.values()])
        mask = torch.stack([maps.garment if name == "offset" else maps.body for maps in frames.values()]) > 0
        shown = values.abs().amax(1)[mask]
        scale = float(shown.kthvalue(max(1, int(0.99 * len(shown)))).values) if len(shown) else 0.0
        picture = (0.5 + 0.5 * values / max(scale, 1e-9)).clamp(0.0, 1.0) * mask[:, None]
        columns.append(torch.nn.functional.pad(picture, (2, 2, 2, 2), value=1.0))
    rows = torch.cat(columns, dim=3)
    return rows.permute(0, 2, 3, 1).reshape(-1, rows.shape[3], 3).numpy()
