"""Covering: cloth that lies beneath skin in sight is moved over it.

Clearing moves vertices out of the body. Between them the faces of cloth may still cut through an elbow, and
a vertex that is deep in a knee leaves it on the wrong side. So skin itself looks for the cloth beneath it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from rasterize.gather import gather
from uvcloth.bodies.body import Body
from uvcloth.geometry.mesh import JoinedMesh
from uvcloth.physics.exposure import Exposure

POINTS = 8000
"""Points over the whole body that look for cloth: about one in a square of 15 mm."""

OVER = 0.002
"""Metres over the skin to which cloth is moved: a face between two points stays over it."""

FARTHEST = 0.45
"""Metres at rest from skin to cloth that may slide over it: a skirt turns around a leg."""


@dataclass(frozen=True)
class Covering:
    """Garments of an outfit, and the skin that they cover at rest.

    rest: all garments at rest, joined. skin: (P, 3) m, the points that they cover there.
    """

    exposure: Exposure
    rest: JoinedMesh
    skin: Tensor

    @classmethod
    def of(cls, body: Body, garments: JoinedMesh) -> "Covering":
        """Prepare garments, welded and joined, that lie on a body at rest."""
        exposure = Exposure(body, [garments], POINTS)
        return cls(exposure, garments, exposure.covered.points(body.mesh.vertices))

    def cover(self, cloth: Tensor, body_vertices: Tensor, follow: Callable[[Tensor, Tensor], None]) -> None:
        """Move cloth (U, 3) m over the skin of a posed body (V, 3) m that it covers at rest, in place.

        follow: lets vertices that did not move follow the moves (U, 3) m of their neighbours.
        """
        shown = self.exposure.shown([cloth], body_vertices)
        corners, weights = self.rest.faces[shown.faces], shown.barycentrics
        # A sleeve that an arm takes into a knee does not cover the knee.
        way = gather(self.rest.vertices, corners, weights) - self.skin[shown.rows]
        covers = way.norm(dim=1) < FARTHEST
        if not covers.any():
            return
        rows, weights = corners[covers].flatten(), weights[covers]
        depths, normals = shown.depths[covers, None], shown.normals[covers, None]
        # The least moves of the corners that move the point of their face by its depth.
        lengths = weights / weights.square().sum(1, keepdim=True) * (depths + OVER)
        ways = (lengths[..., None] * normals).flatten(0, 1)
        longest = torch.zeros_like(cloth[:, 0]).scatter_reduce(0, rows, lengths.flatten(), "amax")
        mean = torch.nn.functional.normalize(torch.zeros_like(cloth).index_add(0, rows, ways), dim=1)
        moves = longest[:, None] * mean
        cloth += moves
        follow(cloth, moves)
