"""What the runtime has to show, in PyTorch: the network on the inputs that it was trained on."""

import math

import torch
from torch import Tensor

from uvcloth.garments.garment import Garment
from uvcloth.geometry.mesh import neighbour_average
from uvcloth.physics.outfit_clearing import CLEARANCE
from uvcloth.physics.surface import BodySurface
from uvcloth.wrinkles.inputs import FARTHEST, Past, first_past, input_maps, texel_inputs
from uvcloth.wrinkles.model import Wrinkles
from uvcloth.wrinkles.sheet import Sheet


class WrinkledInTorch:
    """One garment with wrinkles, frame after frame."""

    def __init__(self, wrinkles: Wrinkles, garment: Garment) -> None:
        self.sheet = Sheet.of(garment, wrinkles.config.size)
        self._wrinkles = wrinkles
        mesh = self.sheet.refined.mesh
        self._average = neighbour_average(mesh.faces, len(mesh.vertices)).float().to_sparse_csr()
        self._past: Past | None = None
        self._shown: Tensor | None = None

    @torch.no_grad()
    def wrinkled(self, vertices: Tensor, fps: float, skin: BodySurface) -> Tensor:
        """Vertices (n, 3) m of the refined mesh with wrinkles, of the next frame of the garment (N, 3) m."""
        config, sheet = self._wrinkles.config, self.sheet
        points = vertices[sheet.refined.kept]
        near = skin.closest(points, FARTHEST)
        past = first_past(sheet, points) if self._past is None else self._past
        rows, axes, self._past = texel_inputs(sheet, points, past, fps, near.signed_distance)
        maps = self._wrinkles.net(input_maps(sheet, rows[None]))
        local = maps[0].flatten(1)[:, sheet.texels.pixels].T.reshape(-1, 3, 4)
        if self._shown is not None and config.lag > 0.0:
            local = local + math.exp(-1.0 / (fps * config.lag)) * (self._shown - local)
        self._shown = local
        rough = config.gain * sheet.at_vertices(axes @ local)
        offsets = 0.5 * (rough + self._average @ rough)
        values = torch.cat([points, near.normals, near.signed_distance[:, None]], dim=1)
        smooth, normals, away = (sheet.refined.matrix @ values).split([3, 3, 1], dim=1)
        outwards = (offsets * normals).sum(1, keepdim=True)
        room = (away - CLEARANCE).clamp(min=0.0)
        return smooth + offsets + (outwards.clamp(min=-room) - outwards) * normals
